//! The built-in segmentors as Python classes, and the adapter that makes any Python object a segmentor.

use numpy::{AllowTypeChange, PyArray1, PyArray2};
use numpy::{IntoPyArray, PyArrayDescrMethods, PyArrayLike1, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use std::sync::Arc;

use super::arrays::{read_only, real_positions};
use super::errors::InvalidParameter;
use super::spans::count;
use crate::error::{Error, Result};
use crate::label::{Labels, NONE};
use crate::lattice::Metric;
use crate::segmentor::{Dbscan, Exactness, Graph, Proximity, Segmentor};
use crate::window::Window;

/// Joins neighbors that are within a distance: on the map's Delaunay triangulation, or all pairs.
///
/// Source: the demonstration of moving-window segmentation, ISPRS Annals I-3 (2012), section 3.2. Points with equal x
/// and y are all kept: they are neighbors of each other and of the neighbors of their place. The radius graph is
/// Euclidean clustering: Rusu, Semantic 3D Object Maps (2009).
///
/// Parameters
/// ----------
/// distance : float
///     Greatest length of a kept edge, in units of the coordinates, above 0. A pair at exactly the distance is joined.
/// graph : {"delaunay", "radius"}, default "delaunay"
///     Which pairs are looked at: neighbors in the triangulation of the map, or all.
/// metric : {"xyz", "xy"}, default "xyz"
///     Whether the length is taken in space or on the map.
///
/// Raises
/// ------
/// InvalidParameter
///     If the distance is not above 0, or the graph or metric is none of those.
///
/// Examples
/// --------
/// >>> Proximity(2.5, metric="xy")
/// Proximity(2.5, graph='delaunay', metric='xy')
#[pyclass(frozen, eq, name = "Proximity", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PyProximity(Proximity);

#[pymethods]
impl PyProximity {
    #[new]
    #[pyo3(signature = (distance, graph = "delaunay", metric = "xyz"))]
    fn new(distance: f64, graph: &str, metric: &str) -> PyResult<Self> {
        let graph = match graph {
            "delaunay" => Graph::Delaunay,
            "radius" => Graph::Radius,
            _ => return Err(Error::parameter("graph", format!("'{graph}'"), "'delaunay' or 'radius'").into()),
        };
        Ok(Self(Proximity::new(distance, metric_of(metric)?)?.with_graph(graph)))
    }

    /// Greatest length of a kept edge, in units of the coordinates.
    #[getter]
    fn distance(&self) -> f64 {
        self.0.distance()
    }

    /// Which pairs are looked at: neighbors in the triangulation ("delaunay"), or all ("radius").
    #[getter]
    fn graph(&self) -> &'static str {
        match self.0.graph() {
            Graph::Delaunay => "delaunay",
            Graph::Radius => "radius",
        }
    }

    /// Whether the length is taken in space ("xyz") or on the map ("xy").
    #[getter]
    fn metric(&self) -> &'static str {
        name_of(self.0.metric())
    }

    fn __getnewargs__(&self) -> (f64, &'static str, &'static str) {
        (self.distance(), self.graph(), self.metric())
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__getnewargs__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        format!("Proximity({:?}, graph='{}', metric='{}')", self.distance(), self.graph(), self.metric())
    }
}

/// Dense places grow together, points at their rim follow the nearest, all others get no segment.
///
/// Source: Ester, Kriegel, Sander and Xu, A density-based algorithm (1996). A point with at least `min_points` points
/// within `eps`, itself included, is a core point; core points within `eps` of each other are one segment. A border
/// point belongs to its nearest core point, at equal distance to the one with the smallest point id: unlike elsewhere,
/// the result does not depend on the order of the points.
///
/// Parameters
/// ----------
/// eps : float
///     How far away neighbors may be, in units of the coordinates, above 0. A pair at exactly eps counts.
/// min_points : int, default 5
///     How many points within eps make a core point, the point itself included; at least 1.
/// metric : {"xyz", "xy"}, default "xyz"
///     Whether distances are taken in space or on the map.
///
/// Raises
/// ------
/// InvalidParameter
///     If eps is not above 0, there are no points, or the metric is none of those.
///
/// Examples
/// --------
/// >>> Dbscan(0.5, min_points=10)
/// Dbscan(0.5, min_points=10, metric='xyz')
#[pyclass(frozen, eq, name = "Dbscan", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PyDbscan(Dbscan);

#[pymethods]
impl PyDbscan {
    #[new]
    #[pyo3(signature = (eps, min_points = Dbscan::MIN_POINTS as i64, metric = "xyz"))]
    fn new(eps: f64, min_points: i64, metric: &str) -> PyResult<Self> {
        Ok(Self(Dbscan::new(eps, count("min_points", min_points)?, metric_of(metric)?)?))
    }

    /// How far away neighbors may be, in units of the coordinates.
    #[getter]
    fn eps(&self) -> f64 {
        self.0.eps()
    }

    /// How many points within eps make a core point.
    #[getter]
    fn min_points(&self) -> usize {
        self.0.min_points()
    }

    /// Whether distances are taken in space ("xyz") or on the map ("xy").
    #[getter]
    fn metric(&self) -> &'static str {
        name_of(self.0.metric())
    }

    fn __getnewargs__(&self) -> (f64, usize, &'static str) {
        (self.eps(), self.min_points(), self.metric())
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__getnewargs__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        format!("Dbscan({:?}, min_points={}, metric='{}')", self.eps(), self.min_points(), self.metric())
    }
}

fn metric_of(name: &str) -> Result<Metric> {
    match name {
        "xyz" => Ok(Metric::Xyz),
        "xy" => Ok(Metric::Xy),
        _ => Err(Error::parameter("metric", format!("'{name}'"), "'xyz' or 'xy'")),
    }
}

fn name_of(metric: Metric) -> &'static str {
    match metric {
        Metric::Xyz => "xyz",
        Metric::Xy => "xy",
    }
}

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

/// The core's segmentor for a Python object: a built-in, or anything with `fit_predict`, or a function of the window.
pub(super) fn segmentor(object: &Bound<'_, PyAny>) -> PyResult<Arc<dyn Segmentor>> {
    if let Ok(proximity) = object.cast::<PyProximity>() {
        return Ok(Arc::new(proximity.get().0));
    }
    if let Ok(dbscan) = object.cast::<PyDbscan>() {
        return Ok(Arc::new(dbscan.get().0));
    }
    let name = match object.getattr("__name__") {
        Ok(name) => name.str()?.to_string(),
        Err(_) => object.get_type().name()?.to_string(),
    };
    let call = if let Ok(fit_predict) = object.getattr("fit_predict")
        && !object.is_instance_of::<pyo3::types::PyType>()
    {
        Call::FitPredict(fit_predict.unbind())
    } else if object.is_callable() && !object.is_instance_of::<pyo3::types::PyType>() {
        Call::Function(object.clone().unbind())
    } else {
        let given = object.repr()?;
        return Err(InvalidParameter::new_err(format!(
            "segmentor is {given}, allowed: a segmentor of streamseg, an object with fit_predict(X), or a function of the window"
        )));
    };
    Ok(Arc::new(Foreign { name, call }))
}

enum Call {
    FitPredict(Py<PyAny>),
    Function(Py<PyAny>),
}

/// A segmentor that a user brought.
struct Foreign {
    name: String,
    call: Call,
}

impl Segmentor for Foreign {
    fn name(&self) -> &str {
        &self.name
    }

    fn exactness(&self) -> Exactness {
        Exactness::Measured
    }

    /// Python objects may keep state between calls.
    fn is_concurrent(&self) -> bool {
        false
    }

    fn segment(&self, window: &Window) -> Result<Labels> {
        if window.points().is_empty() {
            return Ok(Labels::from_any(&[]));
        }
        Python::attach(|py| {
            let answer = self.answer(py, window)?;
            self.labels(answer.bind(py), window.points().len())
        })
    }
}

impl Foreign {
    fn answer(&self, py: Python<'_>, window: &Window) -> Result<Py<PyAny>> {
        let points = real_positions(py, window.points(), window.lattice())?;
        read_only(points.as_any())?;
        Ok(match &self.call {
            Call::FitPredict(fit_predict) => fit_predict.call1(py, (points,))?,
            Call::Function(function) => {
                let point_ids = window.point_ids().into_pyarray(py).unbind();
                let window = PyWindow { index: window.index(), points: points.unbind(), point_ids };
                function.call1(py, (window,))?
            }
        })
    }

    fn labels(&self, answer: &Bound<'_, PyAny>, points: usize) -> Result<Labels> {
        let array = answer
            .py()
            .import(intern!(answer.py(), "numpy"))?
            .call_method1(intern!(answer.py(), "asarray"), (answer,))?;
        let untyped = array.cast::<PyUntypedArray>().map_err(PyErr::from)?;
        if untyped.shape() != [points] {
            let shape = array.getattr("shape")?.repr()?.to_string();
            return Err(
                self.wrong(format!("returned labels of shape {shape}, expected ({points},): one label per point"))
            );
        }
        if !matches!(untyped.dtype().kind(), b'i' | b'u' | b'b') {
            let given = untyped.dtype().to_string();
            return Err(self.wrong(format!("returned labels of type {given}, expected whole numbers; -1 = none")));
        }
        let labels: PyArrayLike1<'_, i64, AllowTypeChange> = array.extract()?;
        let labels: Vec<i64> = labels.as_array().iter().copied().collect();
        if let Some(position) = labels.iter().position(|&label| label < NONE) {
            let given = labels[position];
            return Err(self.wrong(format!("returned the label {given}, allowed: 0 and above, or -1 = none")));
        }
        Ok(Labels::from_any(&labels))
    }

    fn wrong(&self, problem: String) -> Error {
        Error::Labels { segmentor: self.name.clone(), problem }
    }
}
