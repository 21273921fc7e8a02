//! The neighbors of one point after the other.
//!
//! Points of one block have nearly the same surroundings, so these are gathered once. How far the k nearest points can
//! be is known from a point nearby: if k points lie within r of it, they lie within r + d of another at distance d from
//! it. If fewer turn up after all, by rounding, the pyramid is asked; so what is found never depends on what was found
//! before.

use super::cells::{BLOCK, squared_distances, up_to};
use super::grid::{Grid, Neighbor};
use super::nearest::Nearest;
use super::search::Search;
use super::vicinity::Vicinity;

/// Rounding of a squared distance that was added up of two distances, with much to spare.
const SLACK: f64 = 1e-9;

/// Finds the neighbors of points; fast if those asked for one after the other are near each other, as in
/// [`Grid::order`].
pub struct Finder<'a> {
    grid: &'a Grid<'a>,
    /// The block of the last point.
    block: usize,
    vicinity: Option<Vicinity>,
    spare: Vicinity,
    /// A place within whose reach are k points.
    last: Option<([f64; 3], f64)>,
    keys: Vec<u64>,
    candidates: Vec<Neighbor>,
}

impl<'a> Finder<'a> {
    pub(super) fn new(grid: &'a Grid<'a>) -> Self {
        let (keys, candidates) = (Vec::new(), Vec::new());
        Self { grid, block: usize::MAX, vicinity: None, spare: Vicinity::default(), last: None, keys, candidates }
    }

    /// As [`Grid::neighbors`].
    pub fn neighbors(&mut self, point: u32, found: &mut Vec<Neighbor>) {
        let place = self.grid.place(point);
        if place as usize / BLOCK != self.block {
            self.move_to(place as usize / BLOCK);
        }
        if !self.look_around(place) {
            self.grid.neighbors(point, found);
            return;
        }
        found.clear();
        found.push(Neighbor { point, squared: 0.0 });
        self.take_sorted(found);
        if let (Search::Nearest { k, .. }, Some(last)) = (self.grid.search(), found.last())
            && found.len() == k
        {
            self.last = Some((self.grid.cells().point(place), last.squared.sqrt()));
        }
    }

    /// Gathers what lies near a block.
    fn move_to(&mut self, block: usize) {
        self.block = block;
        let (grid, cells, within) = (self.grid, self.grid.cells(), self.grid.within());
        let mut squared_reach = within.limit();
        self.last = None;
        if let Search::Nearest { k, .. } = grid.search() {
            let bounds = &cells.pyramid[0][block];
            let center = std::array::from_fn(|axis| bounds.low[axis] / 2.0 + bounds.high[axis] / 2.0);
            if let Some(squared) = Nearest::farthest(cells, grid.point_ids(), within, block, center, k) {
                let last = (center, squared.sqrt());
                let farthest = within.squared(&center, &bounds.low).max(within.squared(&center, &bounds.high));
                squared_reach = smaller(squared_reach, about(last.1 + farthest.sqrt()));
                self.last = Some(last);
            }
        }
        let mut vicinity = self.vicinity.take().unwrap_or_else(|| std::mem::take(&mut self.spare));
        if squared_reach < f64::INFINITY && vicinity.gather(cells, within, block, squared_reach) {
            self.vicinity = Some(vicinity);
        } else {
            self.spare = vicinity;
        }
    }

    /// Collects what may be a neighbor of the point at `place`; whether all that are have been.
    fn look_around(&mut self, place: u32) -> bool {
        let Some(vicinity) = &self.vicinity else { return false };
        let (grid, cells, within) = (self.grid, self.grid.cells(), self.grid.within());
        let point = cells.point(place);
        let mut reach = vicinity.squared_reach();
        if let Some((nearby, radius)) = self.last {
            reach = smaller(reach, about(radius + within.squared(&nearby, &point).sqrt()));
        }
        self.candidates.clear();
        for block in vicinity.blocks() {
            let bounds = &cells.pyramid[0][block];
            let gap = bounds.squared_gap(&point, &within.weights());
            if gap > reach || bounds.are_beyond(gap, &point, within) {
                continue;
            }
            let squared = squared_distances(&point, &cells.blocks[block], &within.weights());
            for i in up_to(reach, &squared) {
                let (other, squared) = ((block * BLOCK + i) as u32, squared[i]);
                if other != place && grid.is_pair(squared, &point, other) {
                    self.candidates.push(Neighbor { point: cells.order[other as usize], squared });
                }
            }
        }
        match grid.search() {
            Search::Nearest { k, .. } => self.candidates.len() >= k - 1 || reach >= within.limit(),
            _ => true,
        }
    }

    /// Appends the candidates in ascending order of (distance, point id), as many as are wanted.
    fn take_sorted(&mut self, found: &mut Vec<Neighbor>) {
        let wanted = if let Search::Nearest { k, .. } = self.grid.search() { k - 1 } else { usize::MAX };
        let candidates = &self.candidates;
        // A squared distance is not negative, so its bits are in the order of its value. The lowest make room for the
        // number of the candidate; those that then look equal are put in order after the others.
        let numbers = candidates.len().next_power_of_two() as u64 - 1;
        self.keys.clear();
        self.keys.extend((0u64..).zip(candidates).map(|(i, c)| c.squared.to_bits() & !numbers | i));
        let distance = |key: u64| key & !numbers;
        if wanted > 0 && self.keys.len() > 2 * wanted {
            let last = distance(*self.keys.select_nth_unstable(wanted - 1).1);
            self.keys.retain(|&key| distance(key) <= last);
        }
        self.keys.sort_unstable();
        let first = found.len();
        for &key in &self.keys {
            found.push(candidates[(key & numbers) as usize]);
        }
        let mut rest = &mut found[first..];
        for alike in self.keys.chunk_by(|&a, &b| distance(a) == distance(b)) {
            let (alike, others) = rest.split_at_mut(alike.len());
            if alike.len() > 1 {
                alike.sort_unstable_by(|a, b| a.compare(b, self.grid.point_ids()));
            }
            rest = others;
        }
        found.truncate(wanted.saturating_add(first));
    }
}

/// The square of a distance that may be off by rounding.
fn about(distance: f64) -> f64 {
    distance * distance * (1.0 + SLACK)
}

fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}
