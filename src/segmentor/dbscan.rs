//! DBSCAN: dense places grow together, points at their rim follow the nearest, all others are noise.
//!
//! Source: Ester, Kriegel, Sander and Xu (1996). A point with at least so many points within eps, itself included, is a
//! core point. Core points within eps of each other are one segment. A point that is not core but within eps of one is a
//! border point.
//!
//! Departure: there, a border point belongs to whichever segment reached it first. Here it belongs to its nearest core
//! point, at equal distance to the one with the smallest point id, so but for such a tie the result does not depend on the
//! order of points.
//!
//! Streamed, a window says only what no point outside of it can change. More points can only make more core points, so
//! what is core in the window is core in the cloud. Whether a point is none is known when the window holds everything
//! within eps of it, so what a border point belongs to is known when it holds everything within 2 · eps.

use super::{Exactness, Segmented, Segmentor};
use crate::error::{Result, at_least_one, positive};
use crate::label::{Cause, Labels, NONE};
use crate::lattice::Metric;
use crate::neighborhood::{Grid, Search};
use crate::union_find::UnionFind;
use crate::window::Window;

/// Density-based clusters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dbscan {
    eps: f64,
    min_points: usize,
    metric: Metric,
}

impl Dbscan {
    /// The number of points that make a core point if nothing else is asked for, as in scikit-learn.
    pub const MIN_POINTS: usize = 5;

    /// Core points have at least `min_points` points within `eps` (in units of the coordinates), themselves included.
    ///
    /// # Errors
    /// If eps is not a finite number above 0, or the number of points is 0.
    pub fn new(eps: f64, min_points: usize, metric: Metric) -> Result<Self> {
        Ok(Self { eps: positive("eps", eps)?, min_points: at_least_one("min_points", min_points)?, metric })
    }

    /// How far away neighbors may be.
    pub fn eps(&self) -> f64 {
        self.eps
    }

    /// How many points make a core point.
    pub fn min_points(&self) -> usize {
        self.min_points
    }

    /// Which coordinates count for a distance.
    pub fn metric(&self) -> Metric {
        self.metric
    }

    fn search(&self) -> Search {
        match self.metric {
            Metric::Xyz => Search::Ball { radius: self.eps },
            Metric::Xy => Search::Disc { radius: self.eps },
        }
    }
}

impl Segmentor for Dbscan {
    fn name(&self) -> &'static str {
        "dbscan"
    }

    fn exactness(&self) -> Exactness {
        Exactness::WithHalo { reach: self.eps, halo: 2.0 * self.eps }
    }

    fn bytes_per_point(&self) -> usize {
        // One grid of all points, and a copy of the core points with one of their own.
        2 * Grid::BYTES_PER_POINT + 60
    }

    fn cause(&self) -> Cause {
        Cause::Noise
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let (points, point_ids) = (window.points(), window.point_ids());
        let grid = Grid::new(points, point_ids, window.lattice(), self.search());
        let core: Vec<u32> =
            grid.order().iter().copied().filter(|&point| grid.has_neighbors(point, self.min_points)).collect();
        let mut labels = vec![NONE; points.len()];
        for (&point, representative) in core.iter().zip(self.joined(&core, window, point_ids)) {
            labels[point as usize] = i64::from(representative);
        }
        // Where nothing is core, nothing has a border.
        let (border, mut undecided) =
            if core.is_empty() { (vec![], vec![]) } else { self.border(&grid, &labels, window) };
        for (point, nearest) in border {
            labels[point as usize] = labels[nearest as usize];
        }
        undecided.sort_unstable();
        Ok(Segmented { undecided: Some(undecided), ..Labels::from_any(&labels).into() })
    }
}

impl Dbscan {
    /// A representative of the segment of each core point.
    fn joined(&self, core: &[u32], window: &Window, point_ids: &[i64]) -> Vec<u32> {
        let points: Vec<[f64; 3]> = core.iter().map(|&point| window.points()[point as usize]).collect();
        let point_ids: Vec<i64> = core.iter().map(|&point| point_ids[point as usize]).collect();
        let mut sets = UnionFind::new(core.len());
        Grid::new(&points, &point_ids, window.lattice(), self.search()).join_neighbors(&mut sets);
        sets.into_representatives()
    }

    /// The border points that are known to be such, each with its core point; and the points that may be some.
    fn border(&self, grid: &Grid<'_>, core_labels: &[i64], window: &Window) -> (Vec<(u32, u32)>, Vec<u32>) {
        let is_core = |point: u32| core_labels[point as usize] != NONE;
        let mut found = Vec::new();
        let (mut border, mut undecided) = (Vec::new(), Vec::new());
        for &point in grid.order().iter().filter(|&&point| !is_core(point)) {
            if !window.holds(&window.points()[point as usize], 2.0 * self.eps) {
                undecided.push(point);
                continue;
            }
            grid.neighbors(point, &mut found);
            // In ascending order of distance, then of point id.
            let nearest = found.iter().map(|neighbor| neighbor.point).find(|&neighbor| is_core(neighbor));
            border.extend(nearest.map(|nearest| (point, nearest)));
        }
        (border, undecided)
    }
}
