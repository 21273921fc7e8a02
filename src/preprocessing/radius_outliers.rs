//! Radius outlier removal: points that have too few neighbors within a radius.
//!
//! Source: PCL, `Open3D` and PDAL agree on it. All three count neighbors beside the point itself.
//! Departure: a neighbor at exactly the radius counts, as it does everywhere here.

use super::{Preprocessed, Stage, keep_where};
use crate::error::{Result, at_least_one, positive};
use crate::neighborhood::{Grid, Search};
use crate::window::Window;

/// Keeps points that have at least so many neighbors within a radius in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadiusOutlierRemoval {
    radius: f64,
    min_neighbors: usize,
}

impl RadiusOutlierRemoval {
    /// Keeps points with at least `min_neighbors` others within `radius`, in units of the coordinates.
    ///
    /// # Errors
    /// If the radius is not a finite number above 0, or no neighbor is asked for.
    pub fn new(radius: f64, min_neighbors: usize) -> Result<Self> {
        Ok(Self { radius: positive("radius", radius)?, min_neighbors: at_least_one("min_neighbors", min_neighbors)? })
    }

    /// The radius, in units of the coordinates.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// How many neighbors a point has to have at the least, itself not counted.
    pub fn min_neighbors(&self) -> usize {
        self.min_neighbors
    }
}

impl Stage for RadiusOutlierRemoval {
    fn name(&self) -> &'static str {
        "radius outlier removal"
    }

    fn halo(&self) -> f64 {
        self.radius
    }

    fn apply(&self, window: &Window) -> Result<Preprocessed> {
        // More neighbors than are asked for need not be found.
        let k = self.min_neighbors.saturating_add(1);
        let search = Search::Nearest { k, flat: false, within: self.radius };
        let grid = Grid::new(window.points(), window.point_ids(), window.lattice(), search);
        let mut stays = vec![None; window.points().len()];
        let (mut finder, mut found) = (grid.finder(), Vec::new());
        for &point in grid.order() {
            finder.neighbors(point, &mut found);
            let is_known = found.len() == k || window.holds(&window.points()[point as usize], self.radius);
            stays[point as usize] = is_known.then_some(found.len() == k);
        }
        Ok(keep_where(window, stays.into_iter(), self.radius))
    }
}
