//! The k nearest points of a point, the smaller point id first where distances are equal.
//!
//! Up the pyramid from the point's own block, and down again into whatever may hold a nearer point (branch and bound:
//! Friedman, Bentley and Finkel 1977). Bounds at exactly the greatest distance so far are turned away by the smallest
//! id inside, so that thousands of points at one place cost no more than others.

use super::cells::{BLOCK, Bounds, Cells, squared_distances, up_to};
use super::grid::Neighbor;
use crate::lattice::Within;

/// A search for the nearest points of one point.
pub(super) struct Nearest<'a> {
    cells: &'a Cells,
    point_ids: &'a [i64],
    within: &'a Within,
    /// The place in the order of the point in question, which is not found.
    place: u32,
    point: [f64; 3],
    /// How many are wanted.
    wanted: usize,
    /// They come here.
    found: &'a mut Vec<Neighbor>,
    /// The greatest (squared distance, point id) that is still wanted.
    worst: (f64, i64),
    /// As many may be found before those that are not wanted are thrown away.
    room: usize,
}

impl<'a> Nearest<'a> {
    /// Replaces `found` by the point at `place` and the `k - 1` points nearest to it, in ascending order of (distance,
    /// point id).
    pub fn search(
        cells: &'a Cells,
        point_ids: &'a [i64],
        within: &'a Within,
        place: u32,
        k: usize,
        found: &'a mut Vec<Neighbor>,
    ) {
        found.clear();
        if k > 1 {
            let (point, wanted) = (cells.point(place), k - 1);
            let worst = (f64::INFINITY, i64::MAX);
            let mut nearest = Nearest { cells, point_ids, within, place, point, wanted, found, worst, room: wanted };
            nearest.go_up(place as usize / BLOCK);
            nearest.keep_wanted();
            found.sort_unstable_by(|a, b| a.compare(b, point_ids));
        }
        found.insert(0, Neighbor { point: cells.order[place as usize], squared: 0.0 });
    }

    /// The squared distance of the k-th nearest point from any place in or near `block`; None if there are fewer.
    pub fn farthest(
        cells: &Cells,
        point_ids: &[i64],
        within: &Within,
        block: usize,
        point: [f64; 3],
        k: usize,
    ) -> Option<f64> {
        if k > cells.order.len() {
            return None;
        }
        let worst = (f64::INFINITY, i64::MAX);
        let found = &mut Vec::with_capacity(k + BLOCK);
        let mut nearest =
            Nearest { cells, point_ids, within, place: u32::MAX, point, wanted: k, found, worst, room: k };
        nearest.go_up(block);
        nearest.keep_wanted();
        (nearest.found.len() == k).then_some(nearest.worst.0)
    }

    fn go_up(&mut self, start: usize) {
        let mut index = start;
        self.look_at(index);
        for level in 0..self.cells.pyramid.len() {
            let sibling = index ^ 1;
            if let Some(bounds) = self.cells.pyramid[level].get(sibling) {
                self.go_down(level, sibling, self.gap(bounds));
            }
            index /= 2;
        }
    }

    fn gap(&self, bounds: &Bounds) -> f64 {
        bounds.squared_gap(&self.point, &self.within.weights())
    }

    /// Looks at what lies below `index` on `level`, at least as far away as `gap`.
    fn go_down(&mut self, level: usize, index: usize, gap: f64) {
        let bounds = &self.cells.pyramid[level][index];
        if (gap, bounds.smallest_id) >= self.worst || bounds.are_beyond(gap, &self.point, self.within) {
            return;
        }
        if level == 0 {
            self.look_at(index);
            return;
        }
        let children = self.cells.children(level, index);
        let below = &self.cells.pyramid[level - 1];
        let (first, last) = (children.start, children.end - 1);
        let (gap_first, gap_last) = (self.gap(&below[first]), self.gap(&below[last]));
        if first == last {
            self.go_down(level - 1, first, gap_first);
        } else if (gap_last, below[last].smallest_id) < (gap_first, below[first].smallest_id) {
            self.go_down(level - 1, last, gap_last);
            self.go_down(level - 1, first, gap_first);
        } else {
            self.go_down(level - 1, first, gap_first);
            self.go_down(level - 1, last, gap_last);
        }
    }

    fn look_at(&mut self, block: usize) {
        let cells = self.cells;
        let squared = squared_distances(&self.point, &cells.blocks[block], &self.within.weights());
        let limit = if self.worst.0 < self.within.limit() { self.worst.0 } else { self.within.limit() };
        for i in up_to(limit, &squared) {
            let (place, squared) = ((block * BLOCK + i) as u32, squared[i]);
            let neighbor = Neighbor { point: cells.order[place as usize], squared };
            let is_wanted = squared < self.worst.0 || key(&neighbor, self.point_ids) < self.worst;
            if is_wanted && place != self.place && self.within.pair_if(squared, || (self.point, cells.point(place))) {
                self.found.push(neighbor);
            }
        }
        if self.found.len() >= self.room {
            self.keep_wanted();
            self.room = self.wanted + (self.wanted / 2).max(BLOCK);
        }
    }

    /// Throws away what is not wanted.
    fn keep_wanted(&mut self) {
        if self.found.len() >= self.wanted {
            let point_ids = self.point_ids;
            let (_, last, _) = self.found.select_nth_unstable_by(self.wanted - 1, |a, b| a.compare(b, point_ids));
            self.worst = key(last, point_ids);
            self.found.truncate(self.wanted);
        }
    }
}

fn key(neighbor: &Neighbor, point_ids: &[i64]) -> (f64, i64) {
    (neighbor.squared, point_ids[neighbor.point as usize])
}
