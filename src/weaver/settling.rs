//! What becomes of ids in the end, found by reading the log backwards.
//!
//! A join *id → smaller id* is final knowledge about `id` only as far as the smaller one does not lose its own name
//! later. Read backwards, the log settles every id at once: when a join is met, what its smaller id becomes is known
//! already, and so is how large the whole was when it closed. And an id can be forgotten as soon as the reading has
//! passed its birth, so the memory is that of the segments that were in scope together, not of the stream.
//!
//! With late joins it is more. A segment that had gone out of scope and is joined later is remembered from there back to its
//! birth, and a whole that was opened again from there back to the closing that was none: so many ids as late joins reach
//! across the reading's place, from a later window to an earlier one.

use std::collections::BTreeMap;

use rustc_hash::FxHashSet;

use super::aliases::Record;
use super::{Aliases, Selection};
use crate::error::Result;
use crate::label::{NONE, SegmentId};

/// A backward reading of the log: knows what the ids of that time become in the end.
pub struct Settling<'a> {
    selection: &'a Selection,
    /// The records from here on have been read.
    position: u64,
    /// Records before `position` that have been fetched, oldest first.
    block: Vec<[i64; 2]>,
    /// Ids that do not stay what they are.
    becomes: BTreeMap<SegmentId, SegmentId>,
    /// Wholes that were joined after their next closing.
    reopened: FxHashSet<SegmentId>,
}

impl<'a> Settling<'a> {
    /// Starts from the end of the log.
    pub(super) fn new(log: &Aliases, selection: &'a Selection) -> Self {
        Self {
            selection,
            position: log.len(),
            block: Vec::new(),
            becomes: BTreeMap::new(),
            reopened: FxHashSet::default(),
        }
    }

    /// Goes back to `position` of the log it was started from, showing each id that becomes another on the way.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub fn rewind(
        &mut self,
        log: &mut Aliases,
        position: u64,
        mut on_settled: impl FnMut(SegmentId, SegmentId),
    ) -> Result<()> {
        while self.position > position {
            let Some(words) = self.block.pop() else {
                self.block = log.block_before(self.position)?;
                continue;
            };
            self.position -= 1;
            let (id, settled) = match Record::from(words) {
                Record::Births { first } => {
                    drop(self.becomes.split_off(&first));
                    continue;
                }
                Record::Join { id, becomes } => (id, self.becomes.get(&becomes).copied().unwrap_or(becomes)),
                Record::Reopening { id } => {
                    self.reopened.insert(id);
                    continue;
                }
                Record::Closing(whole) if self.reopened.remove(&whole.id) => continue,
                Record::Closing(whole) => (whole.id, self.selection.id_of(&whole)),
            };
            if settled != id {
                self.becomes.insert(id, settled);
                on_settled(id, settled);
            }
        }
        Ok(())
    }

    /// Turns ids that were carried at this position into final ids, in place.
    pub fn settle(&self, ids: &mut [SegmentId]) {
        for run in ids.chunk_by_mut(|a, b| a == b) {
            if run[0] != NONE
                && let Some(&settled) = self.becomes.get(&run[0])
            {
                run.fill(settled);
            }
        }
    }

    /// How many ids are remembered.
    pub fn remembered(&self) -> usize {
        self.becomes.len()
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::super::Closed;
    use super::*;
    use crate::size::{SizeLimits, Sort};

    #[test]
    fn a_chain_of_joins_settles_at_its_end() {
        let mut log = Aliases::default();
        log.mark_births(1);
        log.mark_births(4);
        log.join(4, 3);
        let before_the_u = log.len();
        log.mark_births(5);
        log.join(3, 2);
        log.join(2, 1);

        let all = Selection::default();
        let mut ids = [4, 3, 2, 1, NONE, 5];
        log.resolve(&mut ids, &all).unwrap();
        assert_eq!(ids, [1, 1, 1, 1, NONE, 5]);

        let mut settling = log.settling(&all);
        settling.rewind(&mut log, before_the_u, |_, _| ()).unwrap();
        let mut carried = [3, 3, 2, 1, NONE];
        settling.settle(&mut carried);
        assert_eq!(carried, [1, 1, 1, 1, NONE]);
    }

    #[test]
    fn a_long_log_goes_to_disk_and_only_what_lived_together_is_remembered() {
        // A ground that gets a new id in each of many windows, a pair that meets in a U each time, and a single point.
        let mut log = Aliases::default();
        let windows = 200_000;
        let (ground, mut next) = (1, 2);
        for _ in 0..windows {
            log.mark_births(next);
            log.join(next, ground);
            log.join(next + 2, next + 1);
            log.close(&Closed { id: next + 1, points: 2, has_seed: true });
            log.close(&Closed { id: next + 3, points: 1, has_seed: true });
            next += 4;
        }
        log.close(&Closed { id: ground, points: windows as u64, has_seed: true });
        for sort in [Sort::Native, Sort::Descending] {
            let selection = Selection::new(&mut log, SizeLimits::new(2, None).unwrap(), sort).unwrap();
            let left_out = selection.left_out_points().total();
            assert_eq!((selection.kept_segments(), left_out), (1 + windows as u64, windows as u64));
            let mut most = 0;
            let mut settling = log.settling(&selection);
            for position in (0..log.len()).rev().step_by(7) {
                settling.rewind(&mut log, position, |_, _| ()).unwrap();
                most = most.max(settling.remembered());
            }
            assert!(most <= 5, "{most} remembered");
            let mut ids: Vec<i64> = (0..windows).flat_map(|w| (2..6).map(move |k| k + 4 * w)).collect();
            log.resolve(&mut ids, &selection).unwrap();
            // The ground is the largest, and keeps the number 1.
            let pair = |w: i64| if sort == Sort::Native { 3 + 4 * w } else { 2 + w };
            assert!(ids.chunks(4).zip(0..).all(|(ids, w)| *ids == [1, pair(w), pair(w), NONE]));
        }
    }
}
