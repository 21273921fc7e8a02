//! What lies near one block of points, gathered once for all of them.

use super::cells::{BLOCK, Cells};
use crate::lattice::Within;

/// More blocks than this are not worth keeping: the points of the block are far from each other, or find so many
/// neighbors that looking them up in the pyramid costs little beside.
const MOST: usize = 256;

/// The blocks that can hold points within reach of the points of one block.
#[derive(Debug, Default)]
pub(super) struct Vicinity {
    blocks: Vec<u32>,
    /// Squared distance up to which they are complete.
    squared_reach: f64,
}

impl Vicinity {
    /// Gathers the blocks within reach of all points of `block`; whether they were few enough.
    pub fn gather(&mut self, cells: &Cells, within: &Within, block: usize, squared_reach: f64) -> bool {
        self.blocks.clear();
        self.squared_reach = squared_reach;
        let mut index = block;
        self.blocks.push(block as u32);
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
        true
    }

    fn gather_below(&mut self, cells: &Cells, within: &Within, block: usize, level: usize, index: usize) {
        let (own, other) = (&cells.pyramid[0][block], &cells.pyramid[level][index]);
        let gap = own.squared_gap_between(other, &within.weights());
        if gap > self.squared_reach || own.are_apart(gap, other, within) || self.blocks.len() > MOST {
            return;
        }
        if level == 0 {
            self.blocks.push(index as u32);
            return;
        }
        for child in cells.children(level, index) {
            self.gather_below(cells, within, block, level - 1, child);
        }
    }

    /// The blocks, that of the points first.
    pub fn blocks(&self) -> impl Iterator<Item = usize> {
        self.blocks.iter().map(|&block| block as usize)
    }

    pub fn squared_reach(&self) -> f64 {
        self.squared_reach
    }
}

/// The points of a block, by their places in the order.
pub(super) fn places_of(cells: &Cells, block: usize) -> std::ops::Range<u32> {
    (block * BLOCK) as u32..((block + 1) * BLOCK).min(cells.order.len()) as u32
}
