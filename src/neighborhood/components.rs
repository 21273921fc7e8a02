//! The components of the graph of all pairs within a distance.
//!
//! The blocks are compared with each other down the pyramid, both sides at a time (dual-tree traversal: Gray and Moore
//! 2001; for spanning trees March, Ram and Gray 2010). Most comparisons end early:
//! * bounds further apart than the distance hold no pair;
//! * bounds no larger than the distance are one set without a test, so dense clouds cost no more than sparse ones;
//! * parts whose points are all in one and the same set already need none.

use super::cells::{BLOCK, Bits, Cells, squared_distances, up_to};
use crate::lattice::Within;
use crate::union_find::UnionFind;

/// The sets of points, by their places in the order of `cells`, that are connected by pairs within the distance.
pub(super) fn components(cells: &Cells, within: &Within) -> UnionFind {
    let uniform = cells.pyramid.iter().map(|level| vec![false; level.len()]).collect();
    let mut components = Components {
        cells,
        within,
        sets: UnionFind::new(cells.order.len()),
        uniform,
        main: vec![Bits(0); cells.blocks.len()],
    };
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
    /// The largest set of each block, as far as is known.
    main: Vec<Bits>,
}

impl Components<'_> {
    /// Joins the pairs below `index` on `level`.
    fn join_inside(&mut self, level: usize, index: usize) {
        let bounds = &self.cells.pyramid[level][index];
        if self.within.includes(self.within.squared(&bounds.low, &bounds.high)) {
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
        for block in index << level..((index + 1) << level).min(self.main.len()) {
            self.main[block] = self.all_of(block);
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
            self.join_blocks(a, b);
            return;
        }
        for child in self.cells.children(level, a) {
            for other in self.cells.children(level, b) {
                self.join_between(level - 1, child, other);
            }
        }
    }

    /// Joins the pairs of one block, going from each point to those not reached so far.
    fn join_block(&mut self, block: usize) {
        let first = (block * BLOCK) as u32;
        let mut unreached = self.all_of(block);
        while let Some(start) = unreached.next() {
            let mut set = Bits(1 << start);
            let mut reached = set;
            while let Some(i) = reached.next().filter(|_| unreached.0 != 0) {
                let near = self.near(first + i as u32, block) & unreached;
                near.for_each(|other| self.sets.union(first + i as u32, first + other as u32));
                unreached.0 &= !near.0;
                reached.0 |= near.0;
                set.0 |= near.0;
            }
            if set.0.count_ones() > self.main[block].0.count_ones() {
                self.main[block] = set;
            }
        }
        self.uniform[0][block] = self.main[block] == self.all_of(block);
    }

    /// Joins the pairs of two blocks. Their main sets are joined once, all other points one by one.
    fn join_blocks(&mut self, a: usize, b: usize) {
        let [others_of_a, others_of_b] = [a, b].map(|block| self.others(block));
        if others_of_a.0.count_ones() + others_of_b.0.count_ones() >= self.all_of(a).0.count_ones() {
            for i in self.all_of(a) {
                self.join_to(a, i, b, self.all_of(b));
            }
            return;
        }
        let [main_of_a, main_of_b] = [a, b].map(|block| self.main_place(block));
        if !self.sets.same(main_of_a, main_of_b) {
            let (mut of_a, of_b) = (self.main[a], self.main[b]);
            of_a.any(|i| self.join_to(a, i, b, of_b));
        }
        for i in others_of_a {
            self.join_to(a, i, b, self.all_of(b));
        }
        for i in others_of_b {
            self.join_to(b, i, a, self.main[a]);
        }
    }

    /// Joins point `i` of `block` with those of `among` in another block; whether there was one.
    fn join_to(&mut self, block: usize, i: usize, other: usize, among: Bits) -> bool {
        let place = (block * BLOCK + i) as u32;
        let (bounds, point) = (&self.cells.pyramid[0][other], self.cells.point(place));
        if bounds.are_beyond(bounds.squared_gap(&point, &self.within.weights()), &point, self.within) {
            return false;
        }
        let near = self.near(place, other) & among;
        // One of the main set will do.
        let main = near & self.main[other];
        let once = Bits(main.0 & main.0.wrapping_neg() | near.0 & !main.0);
        once.for_each(|i| self.sets.union(place, (other * BLOCK + i) as u32));
        near.0 != 0
    }

    fn all_of(&self, block: usize) -> Bits {
        Bits(u32::MAX >> (u32::BITS as usize - self.cells.places(0, block).len()))
    }

    fn main_place(&self, block: usize) -> u32 {
        (block * BLOCK) as u32 + self.main[block].0.trailing_zeros()
    }

    /// The points of a block that are not in its main set, as far as is known by now.
    fn others(&mut self, block: usize) -> Bits {
        let main = self.main_place(block);
        for i in Bits(self.all_of(block).0 & !self.main[block].0) {
            if self.sets.same(main, (block * BLOCK + i) as u32) {
                self.main[block].0 |= 1 << i;
            }
        }
        let others = Bits(self.all_of(block).0 & !self.main[block].0);
        self.uniform[0][block] = others.0 == 0;
        others
    }

    /// The points of a block that are within the distance of that at `place`.
    #[inline]
    fn near(&self, place: u32, block: usize) -> Bits {
        let point = self.cells.point(place);
        let squared = squared_distances(&point, &self.cells.blocks[block], &self.within.weights());
        let mut near = up_to(self.within.limit(), &squared);
        for i in near {
            let other = || self.cells.point((block * BLOCK + i) as u32);
            if !self.within.pair_if(squared[i], || (point, other())) {
                near.0 &= !(1 << i);
            }
        }
        near
    }
}
