//! What lies near one block of points, gathered once for all of them.

use super::cells::{Bounds, Cells};
use crate::lattice::Within;

/// More blocks than this are not worth keeping: the points of the block are far from each other, or find so many
/// neighbors that looking them up in the pyramid costs little beside.
pub(super) const MOST: usize = 256;

/// The blocks that can hold points within reach of the points of one block.
#[derive(Debug, Default)]
pub(super) struct Vicinity {
    /// With their bounds and the squared gap to the block, by which they are sorted.
    blocks: Vec<(f64, u32, Bounds)>,
    /// Squared distance up to which they are complete.
    squared_reach: f64,
}

impl Vicinity {
    /// Gathers the blocks within reach of all points of `block`; whether they were few enough.
    pub fn gather(&mut self, cells: &Cells, within: &Within, block: usize, squared_reach: f64) -> bool {
        self.blocks.clear();
        self.squared_reach = squared_reach;
        let mut index = block;
        self.blocks.push((0.0, block as u32, cells.pyramid[0][block]));
        for level in 0..cells.pyramid.len() {
            let sibling = index ^ 1;
            if sibling < cells.pyramid[level].len() {
                self.gather_below(cells, within, block, level, sibling);
            }
            if self.blocks.len() > MOST {
                return false;
            }
            index /= 2;
        }
        self.blocks.sort_by(|a, b| a.0.total_cmp(&b.0));
        true
    }

    fn gather_below(&mut self, cells: &Cells, within: &Within, block: usize, level: usize, index: usize) {
        let (own, other) = (&cells.pyramid[0][block], &cells.pyramid[level][index]);
        let gap = own.squared_gap_between(other, &within.weights());
        if gap > self.squared_reach || own.are_apart(gap, other, within) || self.blocks.len() > MOST {
            return;
        }
        if level == 0 {
            self.blocks.push((gap, index as u32, *other));
            return;
        }
        for child in cells.children(level, index) {
            self.gather_below(cells, within, block, level - 1, child);
        }
    }

    /// The blocks with no larger squared gap to that of the points, nearest first, and their bounds.
    #[inline]
    pub fn up_to(&self, squared_gap: f64) -> impl Iterator<Item = (usize, &Bounds)> {
        let near = self.blocks.iter().take_while(move |(gap, ..)| *gap <= squared_gap);
        near.map(|(_, block, bounds)| (*block as usize, bounds))
    }

    pub fn squared_reach(&self) -> f64 {
        self.squared_reach
    }
}
