//! The components of the graph of all pairs within a distance.
//!
//! The blocks are compared with each other down the pyramid, both sides at a time (dual-tree traversal: Gray and Moore
//! 2001; for spanning trees March, Ram and Gray 2010). Most comparisons end early:
//! * bounds further apart than the distance hold no pair;
//! * bounds no larger than the distance are one set without a test, so dense clouds cost no more than sparse ones;
//! * blocks whose points are all in one and the same set already need none.

use super::cells::{Cells, squared_distances};
use crate::lattice::Within;
use crate::union_find::UnionFind;

/// The sets of points, by their places in the order of `cells`, that are connected by pairs within the distance.
pub(super) fn components(cells: &Cells, within: &Within) -> UnionFind {
    let uniform = cells.pyramid.iter().map(|level| vec![false; level.len()]).collect();
    let mut components = Components { cells, within, sets: UnionFind::new(cells.order.len()), uniform };
    if !cells.order.is_empty() {
        components.join_inside(cells.pyramid.len() - 1, 0);
    }
    components.sets
}

struct Components<'a> {
    cells: &'a Cells,
    within: &'a Within,
    sets: UnionFind,
    /// Whether all points below are known to be one set; by level, as the pyramid.
    uniform: Vec<Vec<bool>>,
}

impl Components<'_> {
    /// Joins the pairs below `index` on `level`.
    fn join_inside(&mut self, level: usize, index: usize) {
        let bounds = &self.cells.pyramid[level][index];
        if self.within.pair(&bounds.low, &bounds.high) {
            self.join_all(level, index);
            return;
        }
        if level == 0 {
            self.join_block(index);
            return;
        }
        let children = self.cells.children(level, index);
        for child in children.clone() {
            self.join_inside(level - 1, child);
        }
        if children.len() == 2 {
            self.join_between(level - 1, children.start, children.start + 1);
        }
        let are_uniform = children.clone().all(|child| self.uniform[level - 1][child]);
        self.uniform[level][index] = are_uniform && self.are_one(level - 1, children.start, children.end - 1);
    }

    /// Joins everything below `index` on `level`.
    fn join_all(&mut self, level: usize, index: usize) {
        let places = self.cells.places(level, index);
        for place in places.clone().skip(1) {
            self.sets.union(places.start, place);
        }
        for below in 0..=level {
            let width = 1 << (level - below);
            let end = ((index + 1) * width).min(self.uniform[below].len());
            self.uniform[below][index * width..end].fill(true);
        }
    }

    fn are_one(&mut self, level: usize, a: usize, b: usize) -> bool {
        let [a, b] = [a, b].map(|index| self.cells.places(level, index).start);
        self.sets.same(a, b)
    }

    /// Joins the pairs of a point below `a` and one below `b`.
    fn join_between(&mut self, level: usize, a: usize, b: usize) {
        let (of_a, of_b) = (&self.cells.pyramid[level][a], &self.cells.pyramid[level][b]);
        let gap = of_a.squared_gap_between(of_b, &self.within.weights());
        if of_a.are_apart(gap, of_b, self.within) {
            return;
        }
        let are_uniform = self.uniform[level][a] && self.uniform[level][b];
        if are_uniform && self.are_one(level, a, b) {
            return;
        }
        if level == 0 {
            self.join_blocks(a, b, are_uniform);
            return;
        }
        for child in self.cells.children(level, a) {
            for other in self.cells.children(level, b) {
                self.join_between(level - 1, child, other);
            }
        }
    }

    /// Joins the pairs of one block.
    fn join_block(&mut self, block: usize) {
        let places = self.cells.places(0, block);
        for place in places.clone() {
            self.join_to_block(place, block, false);
            if self.are_all_one(block) {
                self.uniform[0][block] = true;
                return;
            }
        }
    }

    fn are_all_one(&mut self, block: usize) -> bool {
        let places = self.cells.places(0, block);
        places.clone().all(|place| self.sets.same(places.start, place))
    }

    /// Joins the pairs of two blocks; of uniform ones, the first.
    fn join_blocks(&mut self, a: usize, b: usize, are_uniform: bool) {
        let bounds = &self.cells.pyramid[0][b];
        for place in self.cells.places(0, a) {
            let point = self.cells.point(place);
            let gap = bounds.squared_gap(&point, &self.within.weights());
            if !bounds.are_beyond(gap, &point, self.within) && self.join_to_block(place, b, are_uniform) && are_uniform
            {
                return;
            }
        }
    }

    /// Joins a point with those of a block that are within the distance, or the first of them; whether there was one.
    fn join_to_block(&mut self, place: u32, block: usize, only_first: bool) -> bool {
        let cells = self.cells;
        let point = cells.point(place);
        let squared = squared_distances(&point, &cells.blocks[block], &self.within.weights());
        let mut found = false;
        for other in cells.places(0, block) {
            let i = other as usize % squared.len();
            if self.within.pair_if(squared[i], || (point, cells.point(other))) {
                self.sets.union(place, other);
                found = true;
                if only_first {
                    break;
                }
            }
        }
        found
    }
}
