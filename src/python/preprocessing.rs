//! The steps of preprocessing as Python classes, and the pass that measures a cloud for them.

use std::sync::Arc;

use pyo3::prelude::*;

use super::arrays::{LatticeOf, lattice_of};
use super::calls::call_named;
use super::errors::{InvalidParameter, guarded};
use super::home::Home;
use super::numbers::{Real, Whole};
use super::survey::{Cloud, signals};
use crate::error::Error;
use crate::preprocessing::{
    RadiusOutlierRemoval, Reach, Stage, StatisticalOutlierRemoval, Statistics, VoxelGrid, measure, total_halo,
};

/// Removes points whose nearest neighbors are unusually far away.
///
/// The mean distance d of a point to its k nearest neighbors is compared with T = mean + multiplier * standard deviation
/// of all points' d. Source: Rusu et al. (2008), as three libraries have it:
///
/// * "pcl": k neighbors beside the point itself; an outlier has d > T.
/// * "pdal": the same, but an outlier has d >= T.
/// * "open3d": the point itself is one of the k, at distance 0; an outlier has d >= T, or d = 0 (only duplicates around).
///
/// Parameters
/// ----------
/// k : int, default 8
///     Number of neighbors, from 1 to 100 000; at least 2 in the dialect "open3d".
/// multiplier : float, default 2.0
///     Standard deviations above the mean that are still usual, at least 0.
/// dialect : {"pcl", "pdal", "open3d"}, default "pcl"
///     Whose formula decides.
/// statistics : {"global", "running"}, (int, float, float) or (int, float, float, (float, float)), default "global"
///     Where mean and standard deviation come from. "global": from the whole cloud, in a pass of its own before the run;
///     the cloud has to be stored. "running": from what has come so far, for live sources. Or count, mean and standard
///     deviation of a cloud that was measured before; give these three to judge another cloud. Measured statistics have a
///     fourth element (threshold, reach): in that cloud, with this k, no point with a mean distance up to that threshold has
///     its last neighbor farther away than the reach; that is how much a window loads, and a point with a neighbor
///     farther away is an outlier.
///
/// Raises
/// ------
/// InvalidParameter
///     If a parameter is none of those.
///
/// Examples
/// --------
/// >>> StatisticalOutlierRemoval(k=20, dialect="open3d")
/// StatisticalOutlierRemoval(k=20, multiplier=2.0, dialect='open3d', statistics='global')
/// >>> StatisticalOutlierRemoval(statistics=(1000, 0.5, 0.25)).threshold
/// 1.0
#[pyclass(frozen, eq, name = "StatisticalOutlierRemoval", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PyStatisticalOutlierRemoval {
    removal: StatisticalOutlierRemoval,
    statistics: Origin,
}

/// Where mean and standard deviation come from.
#[derive(Clone, Copy, PartialEq)]
enum Origin {
    Cloud,
    Past,
    Measured(Statistics),
}

#[pymethods]
impl PyStatisticalOutlierRemoval {
    #[new]
    #[pyo3(signature = (k = Whole::of(8), multiplier = Real::of(2.0), dialect = "pcl", statistics = None))]
    fn new(k: Whole, multiplier: Real, dialect: &str, statistics: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let (k, multiplier) = (k.count("k")?, multiplier.named("multiplier")?);
        let removal = StatisticalOutlierRemoval::new(k, multiplier, dialect.parse()?)?;
        Ok(Self { removal, statistics: statistics.map_or(Ok(Origin::Cloud), parse_statistics)? })
    }

    /// Number of neighbors.
    #[getter]
    fn k(&self) -> usize {
        self.removal.k()
    }

    /// Standard deviations above the mean that are still usual.
    #[getter]
    fn multiplier(&self) -> f64 {
        self.removal.multiplier()
    }

    /// Whose formula decides.
    #[getter]
    fn dialect(&self) -> &'static str {
        self.removal.dialect().name()
    }

    /// "global", "running", or count, mean and standard deviation as measured.
    #[getter]
    fn statistics(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        Ok(match self.statistics {
            Origin::Cloud => "global".into_pyobject(py)?.into_any().unbind(),
            Origin::Past => "running".into_pyobject(py)?.into_any().unbind(),
            Origin::Measured(statistics) => in_python(py, &statistics)?,
        })
    }

    /// The mean distance from which on a point is an outlier, in units of the coordinates; None until it was measured.
    #[getter]
    fn threshold(&self) -> Option<f64> {
        match self.statistics {
            Origin::Measured(statistics) => Some(self.removal.threshold(&statistics)),
            Origin::Cloud | Origin::Past => None,
        }
    }

    fn __getnewargs__(&self, py: Python<'_>) -> PyResult<(usize, f64, &'static str, Py<PyAny>)> {
        Ok((self.k(), self.multiplier(), self.dialect(), self.statistics(py)?))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (k, multiplier, dialect) = (self.k(), self.multiplier(), self.dialect());
        let statistics = self.statistics(py)?.bind(py).repr()?.to_string();
        Ok(format!(
            "StatisticalOutlierRemoval(k={k}, multiplier={multiplier:?}, dialect='{dialect}', statistics={statistics})"
        ))
    }
}

fn in_python(py: Python<'_>, statistics: &Statistics) -> PyResult<Py<PyAny>> {
    let Statistics { count, mean, deviation, reach } = *statistics;
    let tuple = match reach {
        Some(Reach { threshold, length }) => (count, mean, deviation, (threshold, length)).into_pyobject(py)?,
        None => (count, mean, deviation).into_pyobject(py)?,
    };
    Ok(tuple.into_any().unbind())
}

fn measured(given: &Bound<'_, PyAny>) -> Option<Statistics> {
    let ((count, mean, deviation), reach) = if let Ok(three) = given.extract() {
        (three, None)
    } else {
        let (count, mean, deviation, (threshold, length)) = given.extract::<(u64, f64, f64, (f64, f64))>().ok()?;
        ((count, mean, deviation), Some(Reach { threshold, length }))
    };
    let numbers = [mean, deviation].into_iter().chain(reach.iter().flat_map(|reach| [reach.threshold, reach.length]));
    let is_possible = numbers.into_iter().all(|value: f64| value.is_finite() && value >= 0.0);
    is_possible.then_some(Statistics { count, mean, deviation, reach })
}

fn parse_statistics(given: &Bound<'_, PyAny>) -> PyResult<Origin> {
    if let Some(statistics) = measured(given) {
        return Ok(Origin::Measured(statistics));
    }
    match given.extract::<String>().as_deref() {
        Ok("global") => Ok(Origin::Cloud),
        Ok("running") => Ok(Origin::Past),
        _ => Err(InvalidParameter::new_err(format!(
            "statistics is {}, allowed: 'global', 'running', or (count, mean, standard deviation)",
            given.repr()?
        ))),
    }
}

/// Removes points that have too few neighbors within a radius.
///
/// Source: as in PCL, Open3D and PDAL, none of which counts the point itself. A neighbor at exactly the radius counts.
///
/// Parameters
/// ----------
/// radius : float
///     Radius in space, in units of the coordinates, above 0.
/// min_neighbors : int, default 2
///     How many other points have to lie within the radius for a point to stay, at least 1.
///
/// Raises
/// ------
/// InvalidParameter
///     If the radius is not above 0 or no neighbor is asked for.
///
/// Examples
/// --------
/// >>> RadiusOutlierRemoval(1.0)
/// RadiusOutlierRemoval(1.0, min_neighbors=2)
#[pyclass(frozen, eq, name = "RadiusOutlierRemoval", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PyRadiusOutlierRemoval(RadiusOutlierRemoval);

#[pymethods]
impl PyRadiusOutlierRemoval {
    #[new]
    #[pyo3(signature = (radius, min_neighbors = Whole::of(2)))]
    fn new(radius: Real, min_neighbors: Whole) -> PyResult<Self> {
        let (radius, min_neighbors) = (radius.named("radius")?, min_neighbors.count("min_neighbors")?);
        Ok(Self(RadiusOutlierRemoval::new(radius, min_neighbors)?))
    }

    /// Radius in space, in units of the coordinates.
    #[getter]
    fn radius(&self) -> f64 {
        self.0.radius()
    }

    /// How many other points have to lie within the radius.
    #[getter]
    fn min_neighbors(&self) -> usize {
        self.0.min_neighbors()
    }

    fn __getnewargs__(&self) -> (f64, usize) {
        (self.radius(), self.min_neighbors())
    }

    fn __repr__(&self) -> String {
        format!("RadiusOutlierRemoval({:?}, min_neighbors={})", self.radius(), self.min_neighbors())
    }
}

/// Thins a cloud: one point stands for all that lie in the same voxel.
///
/// Voxels are cubes counted from absolute zero, floor(coordinate / size), however large the coordinates. Attributes are
/// those of the real point nearest to the centroid. Source: PCL's VoxelGrid.
///
/// Parameters
/// ----------
/// size : float
///     Length of a voxel's edges, in units of the coordinates, above 0.
/// representative : {"centroid", "nearest"}, default "centroid"
///     The mean of the points, with the smallest of their point ids; or the real point nearest to it (of equally near ones
///     that with the smallest point id).
///
/// Raises
/// ------
/// InvalidParameter
///     If the size is not above 0 or the representative is none of those.
///
/// Examples
/// --------
/// >>> VoxelGrid(0.25)
/// VoxelGrid(0.25, representative='centroid')
#[pyclass(frozen, eq, name = "VoxelGrid", module = "streamseg")]
#[derive(Clone, PartialEq)]
pub struct PyVoxelGrid(VoxelGrid);

#[pymethods]
impl PyVoxelGrid {
    #[new]
    #[pyo3(signature = (size, representative = "centroid"))]
    fn new(size: Real, representative: &str) -> PyResult<Self> {
        Ok(Self(VoxelGrid::new(size.named("size")?, representative.parse()?)?))
    }

    /// Length of a voxel's edges, in units of the coordinates.
    #[getter]
    fn size(&self) -> f64 {
        self.0.size()
    }

    /// "centroid" or "nearest".
    #[getter]
    fn representative(&self) -> &'static str {
        self.0.representative().name()
    }

    fn __getnewargs__(&self) -> (f64, &'static str) {
        (self.size(), self.representative())
    }

    fn __repr__(&self) -> String {
        format!("VoxelGrid({:?}, representative='{}')", self.size(), self.representative())
    }
}

/// The core's stages for a list of Python ones. Statistics of a whole cloud have to be measured before.
pub(super) fn stages(list: &Bound<'_, PyAny>) -> PyResult<Vec<Arc<dyn Stage>>> {
    list.try_iter()?.map(|object| stage(&object?)).collect()
}

fn stage(object: &Bound<'_, PyAny>) -> PyResult<Arc<dyn Stage>> {
    if let Ok(removal) = object.cast::<PyStatisticalOutlierRemoval>() {
        let PyStatisticalOutlierRemoval { removal, statistics } = removal.get();
        return match statistics {
            Origin::Measured(statistics) => Ok(Arc::new(removal.with_statistics(*statistics))),
            Origin::Past => Ok(Arc::new(removal.running())),
            Origin::Cloud => Err(InvalidParameter::new_err(format!(
                "{} needs the statistics of the whole cloud before the first point comes, which a live source cannot give; \
                 use statistics='running', or (count, mean, standard deviation) of a cloud like it",
                object.repr()?
            ))),
        };
    }
    if let Ok(removal) = object.cast::<PyRadiusOutlierRemoval>() {
        return Ok(Arc::new(removal.get().0));
    }
    if let Ok(grid) = object.cast::<PyVoxelGrid>() {
        return Ok(Arc::new(grid.get().0));
    }
    Err(InvalidParameter::new_err(format!(
        "preprocess has {}, allowed: StatisticalOutlierRemoval, RadiusOutlierRemoval and VoxelGrid",
        object.repr()?
    )))
}

/// How far around a point the stages depend on what is there; ∞ if there is no limit.
#[pyfunction]
pub(super) fn _halo_of(stages: &Bound<'_, PyAny>) -> PyResult<f64> {
    Ok(total_halo(&self::stages(stages)?))
}

/// Count, mean, standard deviation and reach of a stored cloud for `removal`, which comes after the stages `earlier`; `chunks` gives
/// its chunks each time it is called, and spans are `width` wide.
#[pyfunction]
#[pyo3(signature = (chunks, removal, earlier, *, spans, width, lattice, threads, drop_invalid))]
#[allow(clippy::too_many_arguments)] // one keyword each for Python
pub(super) fn _measure(
    py: Python<'_>,
    chunks: Py<PyAny>,
    removal: &PyStatisticalOutlierRemoval,
    earlier: &Bound<'_, PyAny>,
    spans: Py<PyAny>,
    width: f64,
    lattice: LatticeOf,
    threads: usize,
    drop_invalid: bool,
) -> PyResult<Py<PyAny>> {
    let earlier = stages(earlier)?;
    let (home, removal) = (Home::of("the survey"), removal.removal);
    let grid = lattice_of(lattice)?;
    let statistics = guarded(py, || {
        let mut open = || {
            Python::attach(|py| {
                let chunks = call_named(py, "the source", || chunks.bind(py).call0())?;
                Ok(Cloud::new(&chunks, Some(spans.bind(py)), true, lattice, drop_invalid)?.spans)
            })
            .map_err(|exception: PyErr| Error::from(exception))
        };
        Ok(measure(removal, &earlier, &mut open, grid, width, threads, &mut || Box::new(move || signals(home)))?)
    })?;
    in_python(py, &statistics)
}
