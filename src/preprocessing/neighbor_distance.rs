//! The mean distance of a point to its nearest neighbors, or how much of it a window can tell.

use crate::neighborhood::{Finder, Grid, Neighbor, Search};
use crate::window::Window;

/// Between what the mean distance of a point to its neighbors lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MeanDistance {
    /// It is at least this.
    pub(super) low: f64,
    /// It is at most this; equal to `low` if the window holds all neighbors.
    pub(super) high: f64,
}

/// Distances are compared with those to the border of a window, which rounding may have moved.
const BORDER_SLACK: f64 = 1e-9;

/// Finds the neighbors of points in one window.
pub(super) struct NeighborDistances<'a> {
    window: &'a Window,
    grid: &'a Grid<'a>,
    finder: Finder<'a>,
    /// How many neighbors there should be, the point itself not counted.
    neighbors: usize,
    /// What the sum of their distances is divided by is so many more.
    more: usize,
    found: Vec<Neighbor>,
    farthest: f64,
}

impl<'a> NeighborDistances<'a> {
    /// For means over `neighbors` others, which `grid` finds, divided by `more` than there are.
    pub(super) fn new(window: &'a Window, grid: &'a Grid<'a>, neighbors: usize, more: usize) -> Self {
        Self { window, grid, finder: grid.finder(), neighbors, more, found: Vec::new(), farthest: 0.0 }
    }

    /// The numbers of the points, near ones near each other.
    pub(super) fn order(&self) -> Vec<u32> {
        self.grid.order().to_vec()
    }

    /// What is known of the mean distance of `point`.
    pub(super) fn of(&mut self, point: u32) -> MeanDistance {
        self.finder.neighbors(point, &mut self.found);
        let lengths: Vec<f64> = self.found.iter().skip(1).map(|n| self.grid.length(n.squared)).collect();
        let farthest = lengths.last().copied().unwrap_or(0.0);
        let is_full = lengths.len() == self.neighbors;
        let position = &self.window.points()[point as usize];
        let exact = mean(lengths.iter().copied(), self.more);
        self.farthest = farthest;
        if self.window.holds(position, if is_full { farthest } else { f64::INFINITY }) {
            return MeanDistance { low: exact, high: exact };
        }
        // All that has not been loaded lies beyond the border.
        let border = self.window.distance_to_border(position) * (1.0 - BORDER_SLACK);
        let loaded: f64 = lengths.iter().map(|length| length.min(border)).sum();
        let missing = (self.neighbors - lengths.len()) as f64 * border;
        let low = (loaded + missing) / (self.neighbors + self.more) as f64;
        MeanDistance { low, high: if is_full { exact } else { f64::INFINITY } }
    }

    /// The longest distance to a neighbor of the point asked for last, among those in the window.
    pub(super) fn farthest(&self) -> f64 {
        self.farthest
    }

    /// The same; ∞ if there are too few.
    pub(super) fn last_radius(&self) -> f64 {
        if self.found.len() > self.neighbors { self.farthest } else { f64::INFINITY }
    }
}

/// The points of a window, to find so many neighbors of each beside itself.
pub(super) fn grid_of(window: &Window, neighbors: usize) -> Grid<'_> {
    let neighbors = neighbors.min(window.points().len());
    Grid::new(window.points(), window.point_ids(), window.lattice(), nearest(neighbors))
}

/// The search for so many neighbors beside the point itself.
pub(super) fn nearest(neighbors: usize) -> Search {
    Search::Nearest { k: neighbors.saturating_add(1), flat: false, within: f64::INFINITY }
}

/// The mean of lengths in ascending order, in which equal ones cannot be told apart, so that it has no rounding of its own
/// in any window.
pub(super) fn mean(lengths: impl Iterator<Item = f64>, more: usize) -> f64 {
    let (count, sum) = lengths.fold((0usize, 0.0), |(count, sum), length| (count + 1, sum + length));
    if count == 0 { 0.0 } else { sum / (count + more) as f64 }
}
