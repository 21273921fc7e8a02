//! Made-up surveys as NumPy columns.

use std::sync::{Mutex, PoisonError};

use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::rows;
use super::errors::InvalidParameter;
use crate::scene::{OFFSET, SCALE, Scene, ScenePoint};

/// A made-up survey, "airborne" or "street", point by point in the order of acquisition.
#[pyclass(frozen, name = "Scene", module = "streamseg._core")]
pub struct PyScene(Mutex<Scene>);

#[pymethods]
impl PyScene {
    #[new]
    fn new(kind: &str, seed: u64) -> PyResult<Self> {
        let scene = match kind {
            "airborne" => Scene::airborne_strip(seed),
            "street" => Scene::street(seed),
            _ => return Err(InvalidParameter::new_err(format!("scene is '{kind}', allowed: 'airborne' or 'street'"))),
        };
        Ok(Self(Mutex::new(scene)))
    }

    /// Scale and offset of the lattice, both (x, y, z).
    #[staticmethod]
    fn lattice() -> ([f64; 3], [f64; 3]) {
        ([SCALE; 3], OFFSET)
    }

    /// The next points as columns: `position` (n, 3) int32 on the lattice, and one (n,) array per attribute.
    fn take<'py>(&self, py: Python<'py>, points: usize) -> PyResult<Bound<'py, PyDict>> {
        let taken: Vec<ScenePoint> =
            py.detach(|| self.0.lock().unwrap_or_else(PoisonError::into_inner).by_ref().take(points).collect());
        let columns = PyDict::new(py);
        columns.set_item("position", rows(py, taken.iter().map(|p| p.position).collect())?)?;
        columns.set_item("gps_time", column(py, &taken, |p| p.gps_time))?;
        columns.set_item("intensity", column(py, &taken, |p| p.intensity))?;
        columns.set_item("return_number", column(py, &taken, |p| p.return_number))?;
        columns.set_item("number_of_returns", column(py, &taken, |p| p.number_of_returns))?;
        columns.set_item("classification", column(py, &taken, |p| p.classification))?;
        columns.set_item("scan_direction_flag", column(py, &taken, |p| u8::from(p.scan_direction)))?;
        columns.set_item("edge_of_flight_line", column(py, &taken, |p| u8::from(p.edge_of_flight_line)))?;
        columns.set_item("object_id", column(py, &taken, |p| p.object_id))?;
        Ok(columns)
    }
}

fn column<'py, T: numpy::Element>(
    py: Python<'py>,
    points: &[ScenePoint],
    value: impl Fn(&ScenePoint) -> T,
) -> Bound<'py, PyAny> {
    points.iter().map(value).collect::<Vec<T>>().into_pyarray(py).into_any()
}
