//! In which slab each point of a stream lies.

use std::ops::Range;

use crate::error::Result;
use crate::span::SlabIndex;

/// Tells in which slab each point of a stream lies, run by run.
pub struct Places {
    pub(super) slab_of: SlabIndex,
    /// The slab of the last point.
    at: i64,
}

impl Places {
    pub fn new(slab_of: SlabIndex) -> Self {
        Self { slab_of, at: 0 }
    }

    /// Calls `each` with a slab and the positions of consecutive points that lie there. A point with no valid position
    /// stays with the points it came with.
    pub fn for_each_run(&mut self, points: &[[f64; 3]], mut each: impl FnMut(i64, Range<usize>)) -> Result<()> {
        let mut start = 0;
        for (position, point) in points.iter().enumerate() {
            let at = self.slab_of.of(point)?.unwrap_or(self.at);
            if at != self.at {
                if start < position {
                    each(self.at, start..position);
                }
                (self.at, start) = (at, position);
            }
        }
        if start < points.len() {
            each(self.at, start..points.len());
        }
        Ok(())
    }
}
