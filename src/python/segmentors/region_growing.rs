//! Region growing as a Python class.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::base::{PySegmentor, arguments, radius, value};
use crate::neighborhood::Search;
use crate::python::numbers::{Real, Whole};
use crate::python::searches::search;
use crate::segmentor::{Form, Growth, RegionGrowing};

/// Smooth pieces of surface, bounded by edges and roughness.
///
/// Neighbors whose normals differ by no more than an angle belong together, and a region does not grow on from points of
/// high curvature. Source: Rabbani, van den Heuvel and Vosselman (2006), in the form that PCL gave it; improved region
/// growing (ISPRS Archives XLII-3/W10, 2020). Normals and curvature are those of the cloud if it has them
/// (``NormalX``, ``SurfaceVariation`` and so on), else they are computed from the same neighbors.
///
/// Parameters
/// ----------
/// k : int or None, default 30
///     Neighbors are the k nearest points, the point itself included; None = all within `search_radius`.
/// search_radius : float, optional
///     Points farther away than this, in units of the coordinates, are no neighbors. It is what makes the result of a
///     stream surely that of the whole cloud.
/// angle_deg : float, default 30.0
///     Greatest angle between the normals of neighbors in a region, 0 to 90 degrees.
/// curvature : {"surface_variation", "principal"}, default "surface_variation"
///     Which curvature tells smooth points from rough ones: PCL's, λ₃/(λ₁ + λ₂ + λ₃), from 0 to 1/3; or the greater
///     principal curvature, in 1/units.
/// max_curvature : float or None, default 0.05
///     Regions grow on from points of at most this curvature; None = from all.
/// residual : float, optional
///     Regions grow on to neighbors at most this far from the tangent plane, in units of the coordinates.
/// literal : bool, default False
///     PCL's loop, whose result depends on the order of things, instead of our form, which depends on the points alone.
/// smooth : bool, default True
///     With `literal`: whether normals are compared with the point that the region grows on from, or with its first.
/// **options
///     Those of every `Segmentor`: min_segment_size, max_segment_size, filter, seed_filter, sort, normals.
///
/// Raises
/// ------
/// InvalidParameter
///     If a parameter is outside what is allowed.
///
/// Examples
/// --------
/// >>> RegionGrowing(20, search_radius=1.0, angle_deg=10.0).angle_deg
/// 10.0
#[pyclass(frozen, extends = PySegmentor, name = "RegionGrowing", module = "streamseg")]
pub struct PyRegionGrowing {
    growth: Growth,
}

#[pymethods]
impl PyRegionGrowing {
    #[new]
    #[pyo3(signature = (
        k = Some(Whole::of(30)),
        *,
        search_radius = None,
        angle_deg = Real::of(Growth::default().angle_deg),
        curvature = Growth::default().curvature.name(),
        max_curvature = Growth::default().max_curvature.map(Real::of),
        residual = None,
        literal = false,
        smooth = true,
        **options
    ))]
    #[allow(clippy::too_many_arguments)] // one keyword each for Python
    fn new(
        py: Python<'_>,
        k: Option<Whole>,
        search_radius: Option<&Bound<'_, PyAny>>,
        angle_deg: Real,
        curvature: &str,
        max_curvature: Option<Real>,
        residual: Option<Real>,
        literal: bool,
        smooth: bool,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let k = k.map(|k| k.named("k")).transpose()?;
        let angle_deg = angle_deg.named("angle_deg")?;
        let max_curvature = max_curvature.map(|limit| limit.named("max_curvature")).transpose()?;
        let residual = residual.map(|limit| limit.named("residual")).transpose()?;
        let search = search(k, search_radius, "3d")?;
        let form = if literal { Form::Literal { smooth } } else { Form::OrderFree };
        let growth = Growth { search, angle_deg, curvature: curvature.parse()?, max_curvature, residual, form };
        let given = [
            ("k", value(py, k)?),
            ("search_radius", radius(py, search_radius)?),
            ("angle_deg", value(py, angle_deg)?),
            ("curvature", value(py, curvature)?),
            ("max_curvature", value(py, max_curvature)?),
            ("residual", value(py, residual)?),
            ("literal", value(py, literal)?),
            ("smooth", value(py, smooth)?),
        ];
        let base = PySegmentor::new(RegionGrowing::new(growth)?, "RegionGrowing", arguments(py, given)?, options, 1)?;
        Ok(PyClassInitializer::from(base).add_subclass(Self { growth }))
    }

    /// How many nearest points are neighbors, the point itself included; None = all within the radius.
    #[getter]
    fn k(&self) -> Option<usize> {
        match self.growth.search {
            Search::Nearest { k, .. } => Some(k),
            _ => None,
        }
    }

    /// How far away a neighbor can be, in units of the coordinates; None = no limit.
    #[getter]
    fn search_radius(&self) -> Option<f64> {
        Some(self.growth.search.reach()).filter(|radius| radius.is_finite())
    }

    /// Greatest angle between the normals of neighbors in a region, in degrees.
    #[getter]
    fn angle_deg(&self) -> f64 {
        self.growth.angle_deg
    }

    /// Which curvature tells smooth points from rough ones: "surface_variation" or "principal".
    #[getter]
    fn curvature(&self) -> &'static str {
        self.growth.curvature.name()
    }

    /// Regions grow on from points of at most this curvature; None = from all.
    #[getter]
    fn max_curvature(&self) -> Option<f64> {
        self.growth.max_curvature
    }

    /// Regions grow on to neighbors at most this far from the tangent plane; None = however far.
    #[getter]
    fn residual(&self) -> Option<f64> {
        self.growth.residual
    }

    /// Whether PCL's loop is run.
    #[getter]
    fn literal(&self) -> bool {
        matches!(self.growth.form, Form::Literal { .. })
    }

    /// Whether PCL's loop compares normals with the point that the region grows on from.
    #[getter]
    fn smooth(&self) -> bool {
        !matches!(self.growth.form, Form::Literal { smooth: false })
    }
}
