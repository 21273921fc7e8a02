//! Replays a history, part by part, into carried ids and a log of joins, as if it happened again.
//!
//! A history tells of a segment's successors when the segment goes out of scope, that is later than the weaver saw them.
//! The joins come in another order, so other ids may be carried; what they become in the end is the same. A segment is
//! held until it and all older ones have gone, so the memory is that of the segments in scope.

use std::collections::VecDeque;

use super::{Aliases, Carry};
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
    oldest: SegmentId,
    /// The last id that the history gave.
    last: SegmentId,
}

impl Replay {
    /// Starts before the first part of a history that gave ids from 1 to `last`.
    pub fn new(last: SegmentId) -> Self {
        Self { oldest: 1, last, ..Self::default() }
    }

    /// Takes in one part: the rows of the segments that went out of scope, and the raw ids of the points that did,
    /// which become carried ids. Returns where the log of joins stands.
    ///
    /// # Errors
    /// If an id is not one that this history can have.
    pub fn part(&mut self, rows: &[[SegmentId; 2]], ids: &mut [SegmentId]) -> Result<u64> {
        let in_rows = rows.iter().flatten().copied().max().unwrap_or(NONE);
        let newest = in_rows.max(ids.iter().copied().max().unwrap_or(NONE));
        self.bear(newest)?;
        for &[segment_id, next] in rows {
            self.check(segment_id)?;
            if next != NONE {
                self.check(next)?;
                if let Some(join) = self.carry.join(segment_id, next) {
                    self.aliases.join(join.id, join.becomes);
                }
            }
        }
        for run in ids.chunk_by_mut(|a, b| a == b) {
            if run[0] != NONE {
                self.check(run[0])?;
                run.fill(self.carry.hand_out(run[0]));
            }
        }
        self.forget(rows);
        Ok(self.aliases.len())
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
            self.carry.extend(count);
            self.gone.extend(std::iter::repeat_n(false, count));
        }
        Ok(())
    }

    fn check(&self, segment_id: SegmentId) -> Result<()> {
        if segment_id >= self.oldest { Ok(()) } else { Err(damaged(segment_id)) }
    }

    /// Forgets the oldest segments as far as they have gone.
    fn forget(&mut self, rows: &[[SegmentId; 2]]) {
        for &[segment_id, _] in rows {
            self.gone[(segment_id - self.oldest) as usize] = true;
        }
        let leaving = self.gone.iter().take_while(|gone| **gone).count();
        self.gone.drain(..leaving);
        self.oldest += leaving as i64;
        self.carry.evict_before(self.oldest);
    }

    /// The log of joins.
    pub fn aliases(&mut self) -> &mut Aliases {
        &mut self.aliases
    }
}

fn damaged(segment_id: SegmentId) -> Error {
    Error::DamagedHistory { segment_id }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn joins_told_late_settle_to_the_same() {
        // Segments 1 and 2 meet in 4, which the history tells when they go, after their first points have gone.
        let mut replay = Replay::new(4);
        let mut first = [1, 2, NONE];
        let first_at = replay.part(&[], &mut first).unwrap();
        let mut second = [3, 1, 4];
        replay.part(&[[1, 4], [2, 4], [3, NONE], [4, NONE]], &mut second).unwrap();
        assert_eq!(second, [3, 1, 1]);
        let mut settling = replay.aliases().settling();
        settling.rewind(replay.aliases(), first_at, |_, _| ()).unwrap();
        settling.settle(&mut first);
        assert_eq!(first, [1, 1, NONE]);
    }

    #[test]
    fn a_damaged_history_is_refused() {
        let mut replay = Replay::new(3);
        replay.part(&[[1, NONE]], &mut []).unwrap();
        assert!(replay.part(&[[1, 2]], &mut []).is_err());
        assert!(replay.part(&[], &mut [9]).unwrap_err().to_string().contains("segment 9"));
        assert!(Replay::new(3).part(&[[0, NONE]], &mut []).is_err());
        assert!(Replay::new(i64::MAX).part(&[], &mut [i64::MAX / 2]).is_err());
    }
}
