//! Plane extraction as a Python class.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::base::{PySegmentor, arguments, value};
use super::conditional_clustering::default_radius;
use crate::expression::Calculator;
use crate::python::numbers::{Real, Whole};
use crate::python::searches::search;
use crate::segmentor::{Coplanarity, PlaneExtraction};

/// Planes, grown from seeds where the surface is most even: roofs, walls, streets.
///
/// A neighbor joins a plane if it is near it and its normal agrees; the plane is adjusted as it grows. Source: the plane
/// extraction of OPALS' segmentation module (Pöchtrager, TU Wien, 2016). As there, planes are grown tile by tile, and
/// those of neighboring tiles are joined if they share points and are coplanar. Normals (``NormalX``, ``NormalY``,
/// ``NormalZ``, ``NormalSigma0``) are those of the cloud if it has them, else they are computed from the same neighbors.
///
/// Parameters
/// ----------
/// search_radius : float or sequence of float, default 1.0
///     Neighbors are the points within this distance, in units of the coordinates; with search_mode="2.5d" also
///     [radius, height] or [radius, lowest, highest].
/// k : int, optional
///     Neighbors are only the k nearest of them, the point itself included.
/// search_mode : {"3d", "2.5d", "2d"}, default "3d"
///     Ball, cylinder, or disc on the map.
/// max_distance : float, default 0.05
///     A point joins a plane if its distance from it is below this, in units of the coordinates.
/// max_sigma : float, default 0.05
///     A plane is adjusted anew only if the standard deviation of its points is below this, in units of the coordinates.
/// min_angle_deg : float, default 10.0
///     A point joins a plane if their normals differ by up to this angle, or up to 2·atan(NormalSigma0) if that is more.
/// seed_calculator : str, default "NormalSigma0 < 0.02 ? NormalSigma0 : invalid"
///     Expression that gives each point a weight: planes grow from the points of least weight first, and from none where
///     it is invalid.
/// tile_size : float, optional
///     Side of a tile, in units of the coordinates, at least twice the search radius; None = twenty search radii.
/// **options
///     Those of every `Segmentor`: min_segment_size (100 if not given), max_segment_size, filter, seed_filter, sort, normals.
///
/// Raises
/// ------
/// InvalidParameter
///     If a parameter is outside what is allowed, or the expression cannot be understood.
///
/// Examples
/// --------
/// >>> PlaneExtraction(1.0, max_distance=0.2, seed_calculator="Z > 275 ? NormalSigma0 : invalid").max_distance
/// 0.2
#[pyclass(frozen, extends = PySegmentor, name = "PlaneExtraction", module = "streamseg")]
pub struct PyPlaneExtraction {
    core: PlaneExtraction,
    /// How far away neighbors can be, in units of the coordinates.
    #[pyo3(get)]
    search_radius: Py<PyAny>,
    /// How many of the nearest points are neighbors, the point itself included; None = all within the radius.
    #[pyo3(get)]
    k: Option<i64>,
    /// Whether that is a ball ("3d"), a cylinder ("2.5d"), or a disc on the map ("2d").
    #[pyo3(get)]
    search_mode: String,
}

#[pymethods]
impl PyPlaneExtraction {
    #[new]
    #[pyo3(signature = (
        search_radius = None,
        *,
        k = None,
        search_mode = "3d",
        max_distance = Real::of(Coplanarity::default().max_distance),
        max_sigma = Real::of(Coplanarity::default().max_sigma),
        min_angle_deg = Real::of(Coplanarity::default().min_angle_deg),
        seed_calculator = PlaneExtraction::SEED_CALCULATOR,
        tile_size = None,
        **options
    ))]
    #[allow(clippy::too_many_arguments)] // one keyword each for Python
    fn new(
        py: Python<'_>,
        search_radius: Option<&Bound<'_, PyAny>>,
        k: Option<Whole>,
        search_mode: &str,
        max_distance: Real,
        max_sigma: Real,
        min_angle_deg: Real,
        seed_calculator: &str,
        tile_size: Option<Real>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let k = k.map(|k| k.named("k")).transpose()?;
        let (max_distance, max_sigma) = (max_distance.named("max_distance")?, max_sigma.named("max_sigma")?);
        let min_angle_deg = min_angle_deg.named("min_angle_deg")?;
        let tile_size = tile_size.map(|side| side.named("tile_size")).transpose()?;
        let radii = default_radius(py, search_radius)?;
        let search = search(k, Some(radii.bind(py)), search_mode)?;
        let coplanarity = Coplanarity { max_distance, max_sigma, min_angle_deg, tile_size };
        let core = PlaneExtraction::new(search, coplanarity, Calculator::parse(seed_calculator)?)?;
        let given = [
            ("search_radius", radii.clone_ref(py)),
            ("k", value(py, k)?),
            ("search_mode", value(py, search_mode)?),
            ("max_distance", value(py, max_distance)?),
            ("max_sigma", value(py, max_sigma)?),
            ("min_angle_deg", value(py, min_angle_deg)?),
            ("seed_calculator", value(py, seed_calculator)?),
            ("tile_size", value(py, tile_size)?),
        ];
        let base = PySegmentor::new(core.clone(), "PlaneExtraction", arguments(py, given)?, options, 100)?;
        let own = Self { core, search_radius: radii, k, search_mode: search_mode.into() };
        Ok(PyClassInitializer::from(base).add_subclass(own))
    }

    /// A point joins a plane if its distance from it is below this, in units of the coordinates.
    #[getter]
    fn max_distance(&self) -> f64 {
        self.core.coplanarity().max_distance
    }

    /// A plane is adjusted anew only if the standard deviation of its points is below this, in units of the coordinates.
    #[getter]
    fn max_sigma(&self) -> f64 {
        self.core.coplanarity().max_sigma
    }

    /// Normals that differ by up to this, or up to 2·atan(NormalSigma0) if that is more, agree; in degrees.
    #[getter]
    fn min_angle_deg(&self) -> f64 {
        self.core.coplanarity().min_angle_deg
    }

    /// Expression that gives each point its weight as a seed.
    #[getter]
    fn seed_calculator(&self) -> &str {
        self.core.seed_calculator().text()
    }

    /// Side of a tile, in units of the coordinates.
    #[getter]
    fn tile_size(&self) -> f64 {
        self.core.tile_size()
    }
}
