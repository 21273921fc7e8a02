//! Statistical outlier removal: points whose neighbors are unusually far away.
//!
//! Source: Rusu et al. (2008), as PCL, PDAL and `Open3D` have it, each with a formula of its own ([`Dialect`]). The mean
//! distance d of a point to its nearest neighbors is compared with the mean μ and the standard deviation σ of all points.
//!
//! *Global*: μ and σ are those of the whole cloud, from a pass of their own ([`measure`](super::measure)). With a threshold
//! T that is known a window need not hold all neighbors of a point: if d ≤ T no neighbor is farther away than their number
//! times T; and if one is, then d > T. So a halo of that length decides every point.
//!
//! A few stray points can make T larger than the cloud. So that pass also tells how far away the last neighbor of a point
//! with d ≤ T really is ([`Reach`](super::Reach)), and no more is loaded: a point whose neighbors are not all within that
//! has d > T, whatever it is. Of another cloud this may not be true, or it may have fewer points than neighbors; so that a
//! result never depends on the windows, such a point is an outlier there too.
//!
//! *Running*: μ and σ are those of the points that have been decided so far, and of this window's.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use super::moments::{Moments, Statistics};
use super::neighbor_distance::{MeanDistance, NeighborDistances, grid_of};
use super::{Preprocessed, Stage, keep_where};
use crate::error::{Error, Result};
use crate::window::Window;

/// Whose formula decides. All take σ with n − 1 in the denominator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Dialect {
    /// k neighbors beside the point itself; an outlier has d > T.
    #[default]
    Pcl,
    /// k neighbors beside the point itself; an outlier has d ≥ T.
    Pdal,
    /// k neighbors, the point itself being one of them at distance 0; an outlier has d ≥ T or d = 0. Points with d = 0
    /// count in the mean, but what they deviate from it does not count in σ.
    Open3d,
}

impl std::str::FromStr for Dialect {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "pcl" => Ok(Dialect::Pcl),
            "pdal" => Ok(Dialect::Pdal),
            "open3d" => Ok(Dialect::Open3d),
            _ => Err(Error::parameter("dialect", format!("'{text}'"), "'pcl', 'pdal' or 'open3d'")),
        }
    }
}

impl Dialect {
    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Dialect::Pcl => "pcl",
            Dialect::Pdal => "pdal",
            Dialect::Open3d => "open3d",
        }
    }

    /// Whether d is that of an outlier, if that is sure.
    fn is_outlier(self, d: MeanDistance, threshold: f64) -> Option<bool> {
        let (outlier, inlier) = match self {
            // A threshold of 0 means that all distances are 0.
            Dialect::Pcl => (d.low > threshold, d.high <= threshold || threshold == 0.0),
            Dialect::Pdal => (d.low >= threshold, d.high < threshold),
            Dialect::Open3d => (d.low >= threshold || d.high == 0.0, 0.0 < d.low && d.high < threshold),
        };
        (outlier || inlier).then_some(outlier)
    }
}

/// More neighbors fit in no memory while a cloud is measured.
pub const MOST_NEIGHBORS: usize = 100_000;

/// What is asked for. It becomes a stage when it is known where μ and σ come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatisticalOutlierRemoval {
    k: usize,
    multiplier: f64,
    dialect: Dialect,
}

impl StatisticalOutlierRemoval {
    /// Removes points whose `k` neighbors are farther away than T = μ + `multiplier` · σ on average.
    ///
    /// # Errors
    /// If there is no neighbor or more than [`MOST_NEIGHBORS`], or the multiplier is below 0 or not finite.
    pub fn new(k: usize, multiplier: f64, dialect: Dialect) -> Result<Self> {
        if dialect == Dialect::Open3d && k < 2 {
            return Err(Error::parameter(
                "k",
                k,
                "at least 2 in this dialect, in which the point itself is one of them",
            ));
        }
        if !(multiplier.is_finite() && multiplier >= 0.0) {
            return Err(Error::parameter("multiplier", multiplier, "a finite number of at least 0"));
        }
        if k > MOST_NEIGHBORS {
            return Err(Error::parameter("k", k, "at most 100000"));
        }
        Ok(Self { k: crate::error::at_least_one("k", k)?, multiplier, dialect })
    }

    /// How many neighbors.
    pub fn k(&self) -> usize {
        self.k
    }

    /// How many standard deviations above the mean.
    pub fn multiplier(&self) -> f64 {
        self.multiplier
    }

    /// Whose formula.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// T = μ + multiplier · σ.
    pub fn threshold(&self, statistics: &Statistics) -> f64 {
        statistics.mean + self.multiplier * statistics.deviation
    }

    /// The stage that takes μ and σ as given.
    pub fn with_statistics(self, statistics: Statistics) -> GlobalOutlierRemoval {
        GlobalOutlierRemoval { removal: self, statistics }
    }

    /// The stage that takes μ and σ of what has come so far.
    pub fn running(self) -> RunningOutlierRemoval {
        RunningOutlierRemoval { removal: self, so_far: Mutex::default() }
    }

    /// How many neighbors beside the point itself.
    pub(super) fn others(&self) -> usize {
        self.k - self.itself()
    }

    /// Whether the point itself is one of its k neighbors: 1 or 0.
    pub(super) fn itself(&self) -> usize {
        usize::from(self.dialect == Dialect::Open3d)
    }

    pub(super) fn statistics(&self, moments: &Moments) -> Statistics {
        match self.dialect {
            Dialect::Open3d => moments.statistics_without_deviations_of_zeros(),
            Dialect::Pcl | Dialect::Pdal => moments.statistics(),
        }
    }
}

/// Statistical outlier removal with the statistics of the whole cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalOutlierRemoval {
    removal: StatisticalOutlierRemoval,
    statistics: Statistics,
}

/// More than rounding: the halo has to outweigh that of borders and distances.
const HALO_SLACK: f64 = 1.01;

/// What rounding may do to a distance that was measured.
const REACH_SLACK: f64 = 1e-9;

impl GlobalOutlierRemoval {
    /// A cloud of few points has fewer neighbors to offer.
    fn others(&self) -> usize {
        self.removal.others().min(self.statistics.count.saturating_sub(1) as usize)
    }

    fn threshold(&self) -> f64 {
        self.removal.threshold(&self.statistics)
    }

    /// How far away the last neighbor of a point that stays can be: as was measured for this threshold, or as follows from it.
    fn reach(&self) -> f64 {
        let divisor = (self.others() + self.removal.itself()) as f64;
        let greatest = divisor * self.threshold();
        let measured = self.statistics.reach.filter(|reach| self.threshold() <= reach.threshold);
        measured.map_or(greatest, |reach| reach.length.min(greatest))
    }
}

impl Stage for GlobalOutlierRemoval {
    fn name(&self) -> &'static str {
        "statistical outlier removal"
    }

    fn halo(&self) -> f64 {
        HALO_SLACK * self.reach()
    }

    fn apply(&self, window: &Window) -> Result<Preprocessed> {
        let threshold = self.threshold();
        let reach = self.reach() * (1.0 + REACH_SLACK);
        let grid = grid_of(window, self.others());
        let mut distances = NeighborDistances::new(window, &grid, self.others(), self.removal.itself());
        let mut stays = vec![None; window.points().len()];
        for point in distances.order() {
            let outlier = self.removal.dialect.is_outlier(distances.of(point), threshold);
            let is_in_reach = distances.last_radius() <= reach;
            let is_beyond = || !is_in_reach && window.holds(&window.points()[point as usize], reach);
            stays[point as usize] = match outlier {
                Some(false) if is_in_reach => Some(true),
                Some(true) => Some(false),
                _ => is_beyond().then_some(false),
            };
        }
        Ok(keep_where(window, stays.into_iter(), self.halo()))
    }
}

/// Statistical outlier removal with the statistics of what has come so far.
#[derive(Debug)]
pub struct RunningOutlierRemoval {
    removal: StatisticalOutlierRemoval,
    so_far: Mutex<SoFar>,
}

#[derive(Debug, Default)]
struct SoFar {
    moments: Moments,
    /// What was decided in the last window: a point that comes again keeps its verdict.
    stays: HashMap<i64, bool>,
}

impl Stage for RunningOutlierRemoval {
    fn name(&self) -> &'static str {
        "running statistical outlier removal"
    }

    fn halo(&self) -> f64 {
        f64::INFINITY
    }

    /// Each window's statistics need those of the one before it.
    fn is_concurrent(&self) -> bool {
        false
    }

    fn apply(&self, window: &Window) -> Result<Preprocessed> {
        let mut so_far = self.so_far.lock().unwrap_or_else(PoisonError::into_inner);
        let grid = grid_of(window, self.removal.others());
        let mut distances = NeighborDistances::new(window, &grid, self.removal.others(), self.removal.itself());
        let mut known = vec![None; window.points().len()];
        for point in distances.order() {
            if !so_far.stays.contains_key(&window.point_ids()[point as usize]) {
                let d = distances.of(point);
                known[point as usize] = (d.low == d.high).then_some(d);
            }
        }
        for d in known.iter().flatten() {
            so_far.moments.add(d.high);
        }
        let threshold = self.removal.threshold(&self.removal.statistics(&so_far.moments));
        let stays: Vec<Option<bool>> = (window.point_ids().iter().zip(&known))
            .map(|(id, d)| match d {
                Some(d) => self.removal.dialect.is_outlier(*d, threshold).map(|outlier| !outlier),
                None => so_far.stays.get(id).copied(),
            })
            .collect();
        let decided = window.point_ids().iter().zip(&stays);
        so_far.stays = decided.filter_map(|(&id, &stays)| Some((id, stays?))).collect();
        Ok(keep_where(window, stays.into_iter(), 0.0))
    }
}
