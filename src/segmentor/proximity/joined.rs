//! Which points of a window are one segment.

use std::ops::Range;

use crate::lattice::Within;
use crate::union_find::UnionFind;

/// The points in the order of the neighborhood, and which of them are one.
pub(super) struct Joined {
    points: Vec<[f64; 3]>,
    sets: UnionFind,
    within: Within,
    /// The pairs at hand.
    near: Vec<[u32; 2]>,
    decided: u64,
    open: Vec<[u32; 2]>,
}

impl Joined {
    pub(super) fn new(points: Vec<[f64; 3]>, within: Within) -> Self {
        let sets = UnionFind::new(points.len());
        Self { points, sets, within, near: Vec::new(), decided: 0, open: Vec::new() }
    }

    /// Joins the points of a stack. They are in order of height, so consecutive pairs are enough.
    pub(super) fn join_stack(&mut self, stack: Range<usize>) {
        for upper in stack.start + 1..stack.end {
            self.join_pair(upper - 1, upper);
        }
    }

    /// Joins two stacks whose points are one if any of them are.
    #[inline]
    pub(super) fn join_on_the_map(&mut self, a: Range<usize>, b: Range<usize>) {
        self.join_pair(a.start, b.start);
    }

    #[inline]
    fn join_pair(&mut self, a: usize, b: usize) {
        if self.within.pair(&self.points[a], &self.points[b]) {
            self.sets.union(a as u32, b as u32);
        }
    }

    /// Whether all points of the stacks are one.
    pub(super) fn are_one(&mut self, stacks: [Range<usize>; 4]) -> bool {
        let first = stacks[0].start as u32;
        stacks.into_iter().flatten().all(|point| self.sets.same(first, point as u32))
    }

    /// Joins the near points of two stacks if these are sure to be neighbors; if not, leaves them open.
    #[inline]
    pub(super) fn decide(&mut self, a: Range<usize>, b: Range<usize>, is_final: impl FnOnce() -> bool) {
        if a.len() > 1 || b.len() > 1 {
            self.near.clear();
            self.find_near(a, b);
            if !self.near.is_empty() {
                self.settle_near(is_final());
            }
        } else if self.within.pair(&self.points[a.start], &self.points[b.start]) {
            if is_final() {
                self.decided += 1;
                self.sets.union(a.start as u32, b.start as u32);
            } else {
                self.open.push([a.start.min(b.start) as u32, a.start.max(b.start) as u32]);
            }
        }
    }

    /// The same for two stacks that may have been looked at already.
    pub(super) fn decide_again(&mut self, a: Range<usize>, b: Range<usize>, is_final: bool) {
        self.near.clear();
        self.find_near(a, b);
        self.near.retain(|&[p, q]| !self.sets.same(p, q));
        self.settle_near(is_final);
    }

    fn settle_near(&mut self, is_final: bool) {
        if !is_final {
            self.open.extend_from_slice(&self.near);
            return;
        }
        self.decided += self.near.len() as u64;
        for &[p, q] in &self.near {
            self.sets.union(p, q);
        }
    }

    #[inline]
    fn find_near(&mut self, a: Range<usize>, b: Range<usize>) {
        if a.len() == 1 && b.len() == 1 {
            self.add_if_near(a.start, b.start);
        } else {
            self.find_near_in_tall(a, b);
        }
    }

    /// Finds for each point of `a` the nearest of `b` above and below it. Those of `b` beyond them on the same side
    /// and within the distance of it are within the distance of each other, and so are joined already.
    fn find_near_in_tall(&mut self, a: Range<usize>, b: Range<usize>) {
        let mut above = b.start;
        for point in a {
            let height = self.points[point][2];
            while above < b.end && self.points[above][2] < height {
                above += 1;
            }
            if above < b.end {
                self.add_if_near(point, above);
            }
            if above > b.start {
                self.add_if_near(point, above - 1);
            }
        }
    }

    #[inline]
    fn add_if_near(&mut self, a: usize, b: usize) {
        if self.within.pair(&self.points[a], &self.points[b]) {
            self.near.push([a.min(b) as u32, a.max(b) as u32]);
        }
    }

    /// How many pairs of points have been decided, and the pairs that are open.
    pub(super) fn decisions(&mut self) -> (u64, Vec<[u32; 2]>) {
        (self.decided, std::mem::take(&mut self.open))
    }

    /// The first point of each point's segment.
    pub(super) fn into_representatives(self) -> Vec<u32> {
        self.sets.into_representatives()
    }
}
