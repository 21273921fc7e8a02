//! Conditional clustering as a Python class.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::base::{PySegmentor, arguments, radius, value};
use crate::expression::Criterion;
use crate::python::searches::search;
use crate::segmentor::ConditionalClustering;

/// Points that hold together by a criterion: neighbors that it is true for are one segment.
///
/// Source: the generic region growing of OPALS' segmentation module (Pöchtrager 2016), whose expressions it takes.
/// Attributes that the criterion names and the cloud does not have (normals, curvature) are computed from the same
/// neighbors.
///
/// Parameters
/// ----------
/// criterion : str, default "true"
///     Expression over the attributes of a point and, as ``n[0].name``, of its neighbor, such as
///     ``"abs(Z - n[0].Z) < 0.15"``; the language has a page of its own in the documentation.
/// search_radius : float or sequence of floats, default 1.0
///     Which points are looked at together, in units of the coordinates; with "2.5d" also ``(radius, height)`` or
///     ``(radius, lowest, highest)``.
/// search_mode : {"3d", "2.5d", "2d"}, default "3d"
///     Whether that is a ball, a cylinder, or a disc on the map.
/// **options
///     Those of every `Segmentor`: min_segment_size (default 100), max_segment_size, filter, seed_filter, sort, normals.
///
/// Raises
/// ------
/// InvalidParameter
///     If the criterion cannot be read, with the column; or the search is none of those.
///
/// Notes
/// -----
/// If the criterion is symmetric (``is_symmetric``), the result depends on no order, and a stream gives that of the whole
/// cloud. Otherwise segments grow from seeds in the order of the points.
///
/// Examples
/// --------
/// >>> ConditionalClustering("abs(Z - n[0].Z) < 0.15", search_radius=1.0).is_symmetric
/// True
#[pyclass(frozen, extends = PySegmentor, name = "ConditionalClustering", module = "streamseg")]
pub struct PyConditionalClustering {
    core: ConditionalClustering,
    /// Which points are looked at together: one length, or several for a cylinder.
    #[pyo3(get)]
    search_radius: Py<PyAny>,
    /// Whether that is a ball ("3d"), a cylinder ("2.5d"), or a disc on the map ("2d").
    #[pyo3(get)]
    search_mode: String,
}

#[pymethods]
impl PyConditionalClustering {
    #[new]
    #[pyo3(signature = (criterion = "true", *, search_radius = None, search_mode = "3d", **options))]
    fn new(
        py: Python<'_>,
        criterion: &str,
        search_radius: Option<&Bound<'_, PyAny>>,
        search_mode: &str,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let radii = default_radius(py, search_radius)?;
        let search = search(None, Some(radii.bind(py)), search_mode)?;
        let core = ConditionalClustering::new(Criterion::parse(criterion)?, search);
        let given = [
            ("criterion", value(py, criterion)?),
            ("search_radius", radii.clone_ref(py)),
            ("search_mode", value(py, search_mode)?),
        ];
        let base = PySegmentor::new(core.clone(), "ConditionalClustering", arguments(py, given)?, options, 100)?;
        let own = Self { core, search_radius: radii, search_mode: search_mode.into() };
        Ok(PyClassInitializer::from(base).add_subclass(own))
    }

    /// Expression over the attributes of a point and of its neighbor.
    #[getter]
    fn criterion(&self) -> &str {
        self.core.criterion().text()
    }

    /// Whether the criterion is sure to say the same of (p, n) and (n, p), so that no order matters.
    #[getter]
    fn is_symmetric(&self) -> bool {
        self.core.is_symmetric()
    }
}

/// A search radius as it is kept; 1 if none was given.
pub(super) fn default_radius(py: Python<'_>, given: Option<&Bound<'_, PyAny>>) -> PyResult<Py<PyAny>> {
    match given {
        Some(_) => radius(py, given),
        None => value(py, 1.0),
    }
}
