//! Replays a history, part by part, into carried ids and a log of joins, as if it happened again.
//!
//! A history tells of a segment's successors when the segment goes out of scope, that is later than the weaver saw them.
//! The joins come in another order, so other ids may be carried; what they become in the end is the same. A segment is
//! held until it and all older ones have gone, so the memory is that of the segments in scope. Sizes need no column of
//! their own: the points of a segment have all come when its rows come.

use std::collections::VecDeque;

use rustc_hash::FxHashSet;

use super::{Aliases, Carry, OutOfScope};
use crate::error::{Error, Result};
use crate::label::{NONE, SegmentId};

/// More new segments than this in one part, which has some million rows, are a damaged id.
const MOST_BIRTHS: usize = 1 << 28;

/// The state of a replay.
#[derive(Default)]
pub struct Replay {
    carry: Carry,
    aliases: Aliases,
    /// For each segment held, whether its rows have been seen.
    gone: VecDeque<bool>,
    /// Segments without a seed that have not gone yet.
    seedless: FxHashSet<SegmentId>,
    oldest: SegmentId,
    /// The last id that the history gave.
    last: SegmentId,
    /// Whether segments can be joined after they have gone.
    is_late: bool,
}

impl Replay {
    /// Starts before the first part of a history that gave ids from 1 to `last`.
    pub fn new(last: SegmentId) -> Self {
        Self { oldest: 1, last, ..Self::default() }
    }

    /// The same for a history with late joins: rows of segments that had gone before.
    #[must_use]
    pub fn with_late_joins(self) -> Self {
        Self { carry: Carry::new(OutOfScope::all()), is_late: true, ..self }
    }

    /// Takes in one part: the rows of the segments that went out of scope, the segments that hold no seed, and the raw ids
    /// of the points that went out of scope, which become carried ids. Returns where the log stands.
    ///
    /// # Errors
    /// If an id is not one that this history can have, or the disk fails.
    pub fn part(&mut self, rows: &[[SegmentId; 2]], seedless: &[SegmentId], ids: &mut [SegmentId]) -> Result<u64> {
        let in_rows = rows.iter().flatten().copied().max().unwrap_or(NONE);
        let newest = in_rows.max(ids.iter().copied().max().unwrap_or(NONE));
        self.bear(newest)?;
        self.seedless.extend(seedless);
        for &[segment_id, next] in rows {
            self.check(segment_id)?;
            if next != NONE {
                self.check(next)?;
                self.join(segment_id, next)?;
            }
        }
        for run in ids.chunk_by_mut(|a, b| a == b) {
            if run[0] != NONE {
                if run[0] < self.oldest {
                    return Err(damaged(run[0]));
                }
                run.fill(self.carry.hand_out(run[0], run.len()));
            }
        }
        let position = self.aliases.len();
        self.forget(rows);
        self.carry.spill()?;
        Ok(position)
    }

    /// Ends the replay. Segments that a history without an end has not told of count as having a seed.
    pub fn finish(&mut self) {
        for segment_id in self.oldest..self.carry.next_id() {
            if !self.seedless.contains(&segment_id) {
                self.carry.seed(segment_id);
            }
        }
        self.oldest = self.carry.next_id();
        self.close();
    }

    /// Takes in all ids up to `newest`.
    fn bear(&mut self, newest: SegmentId) -> Result<()> {
        if newest > self.last {
            return Err(damaged(newest));
        }
        let next = self.carry.next_id();
        if newest >= next {
            let count = (newest - next + 1) as usize;
            if count > MOST_BIRTHS {
                return Err(damaged(newest));
            }
            self.aliases.mark_births(next);
            self.carry.extend(count, false);
            self.gone.extend(std::iter::repeat_n(false, count));
        }
        Ok(())
    }

    fn check(&self, segment_id: SegmentId) -> Result<()> {
        let oldest = if self.is_late { 1 } else { self.oldest };
        if segment_id >= oldest { Ok(()) } else { Err(damaged(segment_id)) }
    }

    fn join(&mut self, segment_id: SegmentId, next: SegmentId) -> Result<()> {
        let late = self.carry.join_late(segment_id, next).map_err(|error| match error {
            Error::OutOfScope { .. } => damaged(segment_id),
            other => other,
        })?;
        late.reopened.into_iter().for_each(|id| self.aliases.reopen(id));
        if let Some(join) = late.join {
            self.aliases.join(join.id, join.becomes);
        }
        if let Some(whole) = late.closed {
            self.aliases.close(&whole);
        }
        Ok(())
    }

    /// Forgets the oldest segments as far as they have gone.
    fn forget(&mut self, rows: &[[SegmentId; 2]]) {
        for &[segment_id, _] in rows.iter().filter(|[segment_id, _]| *segment_id >= self.oldest) {
            self.gone[(segment_id - self.oldest) as usize] = true;
            if !self.seedless.contains(&segment_id) {
                self.carry.seed(segment_id);
            }
        }
        let leaving = self.gone.iter().take_while(|gone| **gone).count();
        self.gone.drain(..leaving);
        for segment_id in self.oldest..self.oldest + leaving as i64 {
            self.seedless.remove(&segment_id);
        }
        self.oldest += leaving as i64;
        self.close();
    }

    /// Closes the wholes that have no segment left.
    fn close(&mut self) {
        for whole in self.carry.evict_before(self.oldest) {
            self.aliases.close(&whole);
        }
    }

    /// The log of joins and closings.
    pub fn aliases(&mut self) -> &mut Aliases {
        &mut self.aliases
    }
}

fn damaged(segment_id: SegmentId) -> Error {
    Error::DamagedHistory { segment_id }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::super::{Closed, Selection};
    use super::*;

    #[test]
    fn joins_told_late_settle_to_the_same() {
        // Segments 1 and 2 meet in 4, which the history tells when they go, after their first points have gone.
        let mut replay = Replay::new(4);
        let mut first = [1, 2, NONE];
        let first_at = replay.part(&[], &[], &mut first).unwrap();
        let mut second = [3, 1, 4];
        replay.part(&[[1, 4], [2, 4], [3, NONE], [4, NONE]], &[], &mut second).unwrap();
        assert_eq!(second, [3, 1, 1]);
        let all = Selection::default();
        let mut settling = replay.aliases().settling(&all);
        settling.rewind(replay.aliases(), first_at, |_, _| ()).unwrap();
        settling.settle(&mut first);
        assert_eq!(first, [1, 1, NONE]);
    }

    #[test]
    fn sizes_and_seeds_are_told_when_a_whole_closes() {
        // Segment 3 is told of with its seed missing before its points; 4 never goes, the history has no end.
        let mut replay = Replay::new(4);
        let at = replay.part(&[[1, 2]], &[1, 3], &mut [1, 1, NONE]).unwrap();
        assert_eq!(replay.aliases().len(), at);
        replay.part(&[[2, NONE], [3, NONE]], &[], &mut [2, 3, 4]).unwrap();
        replay.finish();
        let mut closed = Vec::new();
        replay.aliases().for_each_closed(|whole| closed.push(*whole)).unwrap();
        closed.sort_unstable_by_key(|whole| whole.id);
        let whole = |id, points, has_seed| Closed { id, points, has_seed };
        assert_eq!(closed, [whole(1, 3, true), whole(3, 1, false), whole(4, 1, true)]);
    }

    #[test]
    fn a_damaged_history_is_refused() {
        let mut replay = Replay::new(3);
        replay.part(&[[1, NONE]], &[], &mut []).unwrap();
        assert!(replay.part(&[[1, 2]], &[], &mut []).is_err());
        assert!(replay.part(&[], &[], &mut [9]).unwrap_err().to_string().contains("segment 9"));
        assert!(Replay::new(3).part(&[[0, NONE]], &[], &mut []).is_err());
        assert!(Replay::new(i64::MAX).part(&[], &[], &mut [i64::MAX / 2]).is_err());
    }
}
