//! Every join of two wholes, in the order in which they were found, and what ids become in the end.
//!
//! A join *id → smaller id* is final knowledge about `id` only as far as the smaller one does not lose its own name
//! later. Read backwards, the log settles every id at once: when a join is met, what its smaller id becomes is known
//! already. And an id can be forgotten as soon as the reading has passed its birth, so the memory is that of the
//! segments that were in scope together, not of the stream. [`Settling`] is that backward reading.
//!
//! The log keeps its newest records in memory and the others in a temporary file, sixteen bytes each.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};

use rustc_hash::FxHashMap;

use crate::error::{Error, Result};
use crate::label::{NONE, SegmentId};

/// Records kept in memory before they go to the file, and read from it at a time.
const BLOCK: usize = 1 << 16;

/// `[id, becomes]`, or `[BIRTHS, first]`: the ids from `first` on are younger than this record.
type Record = [i64; 2];

/// Ids start from 1, so 0 can mark births.
const BIRTHS: i64 = 0;

/// The log of joins.
#[derive(Debug, Default)]
pub struct Aliases {
    file: Option<File>,
    written: u64,
    newest: Vec<Record>,
}

impl Aliases {
    /// How many records there are; a position in the log.
    pub fn len(&self) -> u64 {
        self.written + self.newest.len() as u64
    }

    /// Whether nothing has been recorded.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Notes that ids from `first` on are about to be given.
    pub fn mark_births(&mut self, first: SegmentId) {
        self.push([BIRTHS, first]);
    }

    /// Notes that `id` has become the smaller id `becomes`.
    pub fn join(&mut self, id: SegmentId, becomes: SegmentId) {
        self.push([id, becomes]);
    }

    fn push(&mut self, record: Record) {
        self.newest.push(record);
        // A full disk costs memory, not the run: what cannot be written waits, and is tried again a block later.
        if self.newest.len().is_multiple_of(BLOCK) && self.write().is_ok() {
            self.written += self.newest.len() as u64;
            self.newest.clear();
        }
    }

    fn write(&mut self) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile()?),
        };
        file.seek(SeekFrom::Start(self.written * size_of::<Record>() as u64))?;
        file.write_all(bytemuck::cast_slice(&self.newest))
    }

    /// The last records before `end`, oldest first; none at the start.
    fn block_before(&mut self, end: u64) -> Result<Vec<Record>> {
        if end > self.written {
            return Ok(self.newest[..(end - self.written) as usize].to_vec());
        }
        let start = end.saturating_sub(BLOCK as u64);
        let mut block = vec![[0; 2]; (end - start) as usize];
        if let Some(file) = &mut self.file {
            file.seek(SeekFrom::Start(start * size_of::<Record>() as u64))
                .and_then(|_| file.read_exact(bytemuck::cast_slice_mut(&mut block)))
                .map_err(|e| Error::spool("read", e))?;
        }
        Ok(block)
    }

    /// Starts reading backwards from the end.
    pub fn settling(&self) -> Settling {
        Settling { position: self.len(), block: Vec::new(), becomes: BTreeMap::new() }
    }

    /// Turns any ids that have been given, raw or carried, into final ids. [`NONE`] stays none.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub fn resolve(&mut self, ids: &mut [SegmentId]) -> Result<()> {
        let mut becomes: FxHashMap<SegmentId, SegmentId> = FxHashMap::default();
        for run in ids.chunk_by(|a, b| a == b) {
            becomes.insert(run[0], run[0]);
        }
        self.settling().rewind(self, 0, |id, settled| {
            if let Some(becomes) = becomes.get_mut(&id) {
                *becomes = settled;
            }
        })?;
        for run in ids.chunk_by_mut(|a, b| a == b) {
            run.fill(becomes[&run[0]]);
        }
        Ok(())
    }
}

/// A backward reading of the log: knows what the ids of that time become in the end.
pub struct Settling {
    /// The records from here on have been read.
    position: u64,
    /// Records before `position` that have been fetched, oldest first.
    block: Vec<Record>,
    becomes: BTreeMap<SegmentId, SegmentId>,
}

impl Settling {
    /// Goes back to `position` of the log it was started from, showing each settled id and what it becomes on the way.
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
            let Some(record) = self.block.pop() else {
                self.block = log.block_before(self.position)?;
                continue;
            };
            self.position -= 1;
            match record {
                [BIRTHS, first] => drop(self.becomes.split_off(&first)),
                [id, becomes] => {
                    let settled = self.becomes.get(&becomes).copied().unwrap_or(becomes);
                    self.becomes.insert(id, settled);
                    on_settled(id, settled);
                }
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
    use super::*;

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

        let mut ids = [4, 3, 2, 1, NONE, 5];
        log.resolve(&mut ids).unwrap();
        assert_eq!(ids, [1, 1, 1, 1, NONE, 5]);

        let mut settling = log.settling();
        settling.rewind(&mut log, before_the_u, |_, _| ()).unwrap();
        let mut carried = [3, 3, 2, 1, NONE];
        settling.settle(&mut carried);
        assert_eq!(carried, [1, 1, 1, 1, NONE]);
    }

    #[test]
    fn a_long_log_goes_to_disk_and_only_what_lived_together_is_remembered() {
        // A ground that gets a new id in each of many windows, and a pair that meets in a U each time.
        let mut log = Aliases::default();
        let windows = 3 * BLOCK as i64;
        let (ground, mut next) = (1, 2);
        for _ in 0..windows {
            log.mark_births(next);
            log.join(next, ground);
            log.join(next + 2, next + 1);
            next += 3;
        }
        assert!(log.written > 0);
        let mut most = 0;
        let mut settling = log.settling();
        for position in (0..log.len()).rev().step_by(7) {
            settling.rewind(&mut log, position, |_, _| ()).unwrap();
            most = most.max(settling.remembered());
        }
        assert!(most <= 2, "{most} remembered");
        let mut ids: Vec<i64> = (0..windows).flat_map(|w| [2 + 3 * w, 3 + 3 * w, 4 + 3 * w]).collect();
        log.resolve(&mut ids).unwrap();
        assert!(ids.chunks(3).zip(0..).all(|(ids, w)| *ids == [1, 3 + 3 * w, 3 + 3 * w]));
    }
}
