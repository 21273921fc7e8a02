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
use super::vicinity::{MOST, Vicinity};
use crate::awaited::is_given_up;

/// Rounding of a squared distance that was added up of two distances, with much to spare.
const SLACK: f64 = 1e-9;

/// The lowest bits of a candidate's key are its number. The others are those of its squared distance: it is not negative,
/// so its bits are in the order of its value. Those that then look equal are put in order after the others.
const NUMBER: u64 = (MOST * BLOCK) as u64 - 1;

/// Finds the neighbors of points; fast if those asked for one after the other are near each other, as in
/// [`Grid::order`].
pub struct Finder<'a> {
    grid: &'a Grid<'a>,
    /// The block of the last point.
    block: usize,
    vicinity: Vicinity,
    /// Whether the vicinity is that of the block; else the pyramid is asked.
    is_gathered: bool,
    /// A place in the block, and within how far of it k points lie; ∞ if that is not known.
    center: ([f64; 3], f64),
    /// The same of the points of the block that had their turn.
    radii: [f64; BLOCK],
    keys: Vec<u64>,
    candidates: Vec<Neighbor>,
}

impl<'a> Finder<'a> {
    pub(super) fn new(grid: &'a Grid<'a>) -> Self {
        Self {
            grid,
            block: usize::MAX,
            vicinity: Vicinity::default(),
            is_gathered: false,
            center: ([0.0; 3], f64::INFINITY),
            radii: [f64::INFINITY; BLOCK],
            keys: Vec::new(),
            candidates: Vec::new(),
        }
    }

    /// As [`Grid::neighbors`].
    pub fn neighbors(&mut self, point: u32, found: &mut Vec<Neighbor>) {
        if is_given_up() {
            self.grid.neighbors(point, found);
            return;
        }
        let place = self.grid.place(point);
        if place as usize / BLOCK != self.block {
            self.move_to(place as usize / BLOCK);
        }
        if !self.is_gathered || !self.look_around(place) {
            self.grid.neighbors(point, found);
            return;
        }
        found.clear();
        found.push(Neighbor { point, squared: 0.0 });
        self.take_sorted(found);
        if let (Search::Nearest { k, .. }, Some(last)) = (self.grid.search(), found.last())
            && found.len() == k
        {
            self.radii[place as usize % BLOCK] = last.squared.sqrt();
        }
    }

    /// Gathers what lies near a block.
    fn move_to(&mut self, block: usize) {
        self.block = block;
        let (grid, cells, within) = (self.grid, self.grid.cells(), self.grid.within());
        let mut squared_reach = within.limit();
        self.center.1 = f64::INFINITY;
        self.radii.fill(f64::INFINITY);
        if let Search::Nearest { k, .. } = grid.search() {
            let bounds = &cells.pyramid[0][block];
            let center = std::array::from_fn(|axis| bounds.low[axis] / 2.0 + bounds.high[axis] / 2.0);
            if let Some(squared) = Nearest::farthest(cells, grid.point_ids(), within, block, center, k) {
                self.center = (center, squared.sqrt());
                let to_corner = within.squared(&center, &bounds.low).max(within.squared(&center, &bounds.high)).sqrt();
                squared_reach = smaller(squared_reach, about(self.center.1 + to_corner));
            }
        }
        self.is_gathered = squared_reach < f64::INFINITY && self.vicinity.gather(cells, within, block, squared_reach);
    }

    /// Collects what may be a neighbor of the point at `place`; whether all that are have been.
    fn look_around(&mut self, place: u32) -> bool {
        let (grid, cells, within) = (self.grid, self.grid.cells(), self.grid.within());
        let point = cells.point(place);
        let reach = self.squared_reach(&point);
        self.candidates.clear();
        self.keys.clear();
        for (block, bounds) in self.vicinity.up_to(reach) {
            let gap = bounds.squared_gap(&point, &within.weights());
            if gap > reach || bounds.are_beyond(gap, &point, within) {
                continue;
            }
            let squared = squared_distances(&point, &cells.blocks[block], &within.weights());
            for i in up_to(reach, &squared) {
                let (other, squared) = ((block * BLOCK + i) as u32, squared[i]);
                if other != place && grid.is_pair(squared, &point, other) {
                    self.keys.push(squared.to_bits() & !NUMBER | self.candidates.len() as u64);
                    self.candidates.push(Neighbor { point: cells.order[other as usize], squared });
                }
            }
        }
        match grid.search() {
            Search::Nearest { k, .. } => self.candidates.len() >= k - 1 || reach >= within.limit(),
            _ => true,
        }
    }

    /// How far around a point of the block all that is wanted lies.
    fn squared_reach(&self, point: &[f64; 3]) -> f64 {
        let (cells, within) = (self.grid.cells(), self.grid.within());
        if !matches!(self.grid.search(), Search::Nearest { .. }) {
            return within.limit();
        }
        let mut reach = self.center.1 + within.squared(&self.center.0, point).sqrt();
        let squared = squared_distances(point, &cells.blocks[self.block], &within.weights());
        for (radius, squared) in self.radii.iter().zip(squared) {
            reach = smaller(radius + squared.sqrt(), reach);
        }
        smaller(about(reach), self.vicinity.squared_reach())
    }

    /// Appends the candidates in ascending order of (distance, point id), as many as are wanted.
    fn take_sorted(&mut self, found: &mut Vec<Neighbor>) {
        let wanted = if let Search::Nearest { k, .. } = self.grid.search() { k - 1 } else { usize::MAX };
        let candidates = &self.candidates;
        let distance = |key: u64| key & !NUMBER;
        if wanted > 0 && self.keys.len() > wanted.saturating_mul(2) {
            let last = distance(*self.keys.select_nth_unstable(wanted - 1).1);
            self.keys.retain(|&key| distance(key) <= last);
        }
        self.keys.sort_unstable();
        let first = found.len();
        for &key in &self.keys {
            found.push(candidates[(key & NUMBER) as usize]);
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
