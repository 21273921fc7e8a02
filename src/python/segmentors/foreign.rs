//! Segmentors that a user brought: any object with `fit_predict(X)`, or a function of the window.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};

use super::labels::labels_of;
use crate::error::{Error, Result};
use crate::label::Labels;
use crate::python::arrays::{read_only, real_positions};
use crate::python::calls::call;
use crate::python::errors::{InvalidParameter, SegmentorError};
use crate::segmentor::{Exactness, Segmented, Segmentor};
use crate::window::Window;

/// What a function used as a segmentor gets: the points of one window.
///
/// Points with invalid coordinates (`drop_invalid`) are left out.
#[pyclass(frozen, name = "WindowPoints", module = "streamseg")]
pub struct PyWindow {
    /// Number of the window, from 0.
    #[pyo3(get)]
    index: u64,
    /// Real coordinates, (n, 3) float64, not writable.
    #[pyo3(get)]
    points: Py<PyArray2<f64>>,
    /// Point ids, (n,) int64.
    #[pyo3(get)]
    point_ids: Py<PyArray1<i64>>,
    /// Name → (n,) float64, for the names in the function's own attribute `attributes`.
    #[pyo3(get)]
    attributes: Py<PyDict>,
}

#[pymethods]
impl PyWindow {
    fn __len__(&self, py: Python<'_>) -> usize {
        self.point_ids.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        format!("WindowPoints(index={}, points={})", self.index, self.point_ids.bind(py).len())
    }
}

enum Call {
    FitPredict(Py<PyAny>),
    Function(Py<PyAny>),
}

/// A segmentor that a user brought.
pub(super) struct Foreign {
    name: String,
    /// The attributes that its own attribute `attributes` names.
    attributes: Vec<String>,
    call: Call,
}

impl Foreign {
    /// Anything that labels points.
    pub(super) fn new(object: &Bound<'_, PyAny>) -> PyResult<Self> {
        let name = match object.getattr("__name__") {
            Ok(name) => name.str()?.to_string(),
            Err(_) => object.get_type().name()?.to_string(),
        };
        let call = if let Ok(fit_predict) = object.getattr("fit_predict")
            && !object.is_instance_of::<PyType>()
        {
            Call::FitPredict(fit_predict.unbind())
        } else if object.is_callable() && !object.is_instance_of::<PyType>() {
            Call::Function(object.clone().unbind())
        } else {
            let given = object.repr()?;
            return Err(InvalidParameter::new_err(format!(
                "segmentor is {given}, allowed: a segmentor of streamseg, an object with fit_predict(X), or a function of the window"
            )));
        };
        let attributes = object.getattr("attributes").and_then(|names| names.extract()).unwrap_or_default();
        Ok(Self { name, attributes, call })
    }
}

impl Segmentor for Foreign {
    fn name(&self) -> &str {
        &self.name
    }

    fn attributes(&self) -> Vec<String> {
        self.attributes.clone()
    }

    fn exactness(&self) -> Exactness {
        Exactness::Measured { reach: 0.0, halo: 0.0 }
    }

    /// Python objects may keep state between calls.
    fn is_concurrent(&self) -> bool {
        false
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        if window.points().is_empty() {
            return Ok(Labels::from_any(&[]).into());
        }
        Python::attach(|py| {
            let (name, index) = (&self.name, window.index());
            let escaped = |what: &str| {
                SegmentorError::new_err(format!(
                    "segmentor '{name}' raised {what} in window {index}, which would have ended the run as if all points \
                     had come"
                ))
            };
            let labels = call(py, escaped, || {
                let answer = self.answer(py, window)?;
                labels_of(answer.bind(py), window.points().len())
            });
            let labels = labels.map_err(|exception| self.marked(py, exception, index))?;
            Ok(labels.map_err(|problem| self.wrong(problem))?.into())
        })
    }
}

impl Foreign {
    fn answer(&self, py: Python<'_>, window: &Window) -> PyResult<Py<PyAny>> {
        let points = real_positions(py, window.points(), window.lattice())?;
        read_only(points.as_any())?;
        Ok(match &self.call {
            Call::FitPredict(fit_predict) => fit_predict.call1(py, (points,))?,
            Call::Function(function) => {
                let point_ids = window.point_ids().to_vec().into_pyarray(py).unbind();
                let attributes = PyDict::new(py);
                for name in &self.attributes {
                    let values = window.columns().get(name).map_or_else(Vec::new, <[f64]>::to_vec).into_pyarray(py);
                    read_only(values.as_any())?;
                    attributes.set_item(name, values)?;
                }
                let (index, attributes) = (window.index(), attributes.unbind());
                let window = PyWindow { index, points: points.unbind(), point_ids, attributes };
                function.call1(py, (window,))?
            }
        })
    }

    /// Writes onto an exception whose it is and in which window it was raised, for those who tell people.
    fn marked(&self, py: Python<'_>, exception: PyErr, window: u64) -> PyErr {
        if !exception.is_instance_of::<PyKeyboardInterrupt>(py) {
            // Where the exception takes no attributes, it is told like any other.
            let _ = exception.value(py).setattr(intern!(py, "_streamseg_raised_in"), (&self.name, window));
        }
        exception
    }

    fn wrong(&self, problem: String) -> Error {
        Error::Labels { segmentor: self.name.clone(), problem }
    }
}
