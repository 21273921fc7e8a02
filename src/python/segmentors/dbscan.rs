//! DBSCAN as a Python class.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::base::{PySegmentor, arguments, value};
use super::proximity::metric_of;
use crate::python::numbers::{Real, Whole};
use crate::segmentor::Dbscan;

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
/// **options
///     Those of every `Segmentor`: min_segment_size, max_segment_size, filter, seed_filter, sort, normals.
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
#[pyclass(frozen, extends = PySegmentor, name = "Dbscan", module = "streamseg")]
pub struct PyDbscan {
    /// How far away neighbors may be, in units of the coordinates.
    #[pyo3(get)]
    eps: f64,
    /// How many points within eps make a core point, the point itself included.
    #[pyo3(get)]
    min_points: usize,
    /// Whether distances are taken in space ("xyz") or on the map ("xy").
    #[pyo3(get)]
    metric: String,
}

#[pymethods]
impl PyDbscan {
    #[new]
    #[pyo3(signature = (eps, min_points = Whole::of(Dbscan::MIN_POINTS), metric = "xyz", **options))]
    fn new(
        py: Python<'_>,
        eps: Real,
        min_points: Whole,
        metric: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let (eps, min_points) = (eps.named("eps")?, min_points.count("min_points")?);
        let core = Dbscan::new(eps, min_points, metric_of(metric)?)?;
        let given = [("eps", value(py, eps)?), ("min_points", value(py, min_points)?), ("metric", value(py, metric)?)];
        let base = PySegmentor::new(core, "Dbscan", arguments(py, given)?, options, 1)?;
        Ok(PyClassInitializer::from(base).add_subclass(Self { eps, min_points, metric: metric.into() }))
    }
}
