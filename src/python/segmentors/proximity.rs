//! Proximity as a Python class.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::base::{PySegmentor, arguments, value};
use crate::lattice::Metric;
use crate::python::errors::InvalidParameter;
use crate::python::numbers::Real;
use crate::segmentor::{Graph, Proximity};

/// Joins neighbors that are within a distance: on the map's Delaunay triangulation, or all there are.
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
///     Which pairs are looked at: neighbors on the map's triangulation, or all.
/// metric : {"xyz", "xy"}, default "xyz"
///     Whether the length is taken in space or on the map.
/// **options
///     Those of every `Segmentor`: min_segment_size, max_segment_size, filter, seed_filter, sort, normals.
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
#[pyclass(frozen, extends = PySegmentor, name = "Proximity", module = "streamseg")]
pub struct PyProximity {
    /// Greatest length of a kept edge, in units of the coordinates.
    #[pyo3(get)]
    distance: f64,
    /// Which pairs are looked at: "delaunay" or "radius".
    #[pyo3(get)]
    graph: String,
    /// Whether the length is taken in space ("xyz") or on the map ("xy").
    #[pyo3(get)]
    metric: String,
}

/// The metric of a name.
pub(super) fn metric_of(name: &str) -> PyResult<Metric> {
    match name {
        "xyz" => Ok(Metric::Xyz),
        "xy" => Ok(Metric::Xy),
        _ => Err(InvalidParameter::new_err(format!("metric is '{name}', allowed: 'xyz' or 'xy'"))),
    }
}

#[pymethods]
impl PyProximity {
    #[new]
    #[pyo3(signature = (distance, graph = "delaunay", metric = "xyz", **options))]
    fn new(
        py: Python<'_>,
        distance: Real,
        graph: &str,
        metric: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let distance = distance.named("distance")?;
        let pairs = match graph {
            "delaunay" => Graph::Delaunay,
            "radius" => Graph::Radius,
            _ => return Err(InvalidParameter::new_err(format!("graph is '{graph}', allowed: 'delaunay' or 'radius'"))),
        };
        let core = Proximity::new(distance, metric_of(metric)?)?.with_graph(pairs);
        let given = [("distance", value(py, distance)?), ("graph", value(py, graph)?), ("metric", value(py, metric)?)];
        let base = PySegmentor::new(core, "Proximity", arguments(py, given)?, options, 1)?;
        let own = Self { distance, graph: graph.into(), metric: metric.into() };
        Ok(PyClassInitializer::from(base).add_subclass(own))
    }
}
