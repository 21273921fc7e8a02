//! The log: every join of two wholes and every closing of one, in the order in which they were found.
//!
//! A whole is closed when none of its segments is in scope: its id is final then, and so is its size. Read backwards, the
//! log tells what every id becomes ([`Settling`]), and each whole's size before any span that holds it.
//!
//! The log keeps its newest records in memory and the others in a temporary file, sixteen bytes each.

use rustc_hash::{FxHashMap, FxHashSet};

use super::{Closed, Selection, Settling};
use crate::disk::WordFile;
use crate::error::Result;
use crate::label::SegmentId;

/// Records kept in memory before they go to the file, and read from it at a time.
const BLOCK: usize = 1 << 16;

/// What the log can tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Record {
    /// The ids from `first` on are younger than this record.
    Births { first: SegmentId },
    /// `id` has become the smaller id `becomes`.
    Join { id: SegmentId, becomes: SegmentId },
    /// No later window can touch this whole.
    Closing(Closed),
    /// The last closing of this whole was none: a late join has touched it.
    Reopening { id: SegmentId },
}

/// No number of points, nor the complement of one.
const REOPENED: i64 = i64::MIN;

/// Two words per record. Ids start from 1, so the first word tells the kind: 0 for births, the id of a join, the negative
/// id of a closing. The number of points of a whole without a seed is complemented.
impl From<Record> for [i64; 2] {
    fn from(record: Record) -> Self {
        match record {
            Record::Births { first } => [0, first],
            Record::Join { id, becomes } => [id, becomes],
            Record::Closing(Closed { id, points, has_seed: true }) => [-id, points as i64],
            Record::Closing(Closed { id, points, has_seed: false }) => [-id, !(points as i64)],
            Record::Reopening { id } => [-id, REOPENED],
        }
    }
}

impl From<[i64; 2]> for Record {
    fn from([first, second]: [i64; 2]) -> Self {
        match first {
            0 => Record::Births { first: second },
            1.. => Record::Join { id: first, becomes: second },
            _ if second == REOPENED => Record::Reopening { id: -first },
            _ if second < 0 => Record::Closing(Closed { id: -first, points: !second as u64, has_seed: false }),
            _ => Record::Closing(Closed { id: -first, points: second as u64, has_seed: true }),
        }
    }
}

/// The log of joins and closings.
#[derive(Debug, Default)]
pub struct Aliases {
    file: WordFile,
    written: u64,
    newest: Vec<[i64; 2]>,
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
        self.push(Record::Births { first });
    }

    /// Notes that `id` has become the smaller id `becomes`.
    pub fn join(&mut self, id: SegmentId, becomes: SegmentId) {
        self.push(Record::Join { id, becomes });
    }

    /// Notes that a whole that had been closed is open again.
    pub fn reopen(&mut self, id: SegmentId) {
        self.push(Record::Reopening { id });
    }

    /// Notes that no later window can touch a whole.
    pub fn close(&mut self, whole: &Closed) {
        self.push(Record::Closing(*whole));
    }

    fn push(&mut self, record: Record) {
        self.newest.push(record.into());
        // A full disk costs memory, not the run: what cannot be written waits, and is tried again a block later.
        if self.newest.len().is_multiple_of(BLOCK) && self.file.write_at(place(self.written), &self.newest).is_ok() {
            self.written += self.newest.len() as u64;
            self.newest.clear();
        }
    }

    /// The last records before `end`, oldest first; none at the start.
    pub(super) fn block_before(&mut self, end: u64) -> Result<Vec<[i64; 2]>> {
        if end > self.written {
            return Ok(self.newest[..(end - self.written) as usize].to_vec());
        }
        let start = end.saturating_sub(BLOCK as u64);
        self.file.read_at(place(start), (end - start) as usize)
    }

    /// Shows every whole that has been closed for good, in no particular order.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub fn for_each_closed(&mut self, mut on_closed: impl FnMut(&Closed)) -> Result<()> {
        let mut position = self.len();
        let mut reopened = FxHashSet::default();
        while position > 0 {
            let block = self.block_before(position)?;
            position -= block.len() as u64;
            for words in block.into_iter().rev() {
                match words.into() {
                    Record::Reopening { id } => drop(reopened.insert(id)),
                    Record::Closing(whole) if !reopened.remove(&whole.id) => on_closed(&whole),
                    _ => (),
                }
            }
        }
        Ok(())
    }

    /// Starts reading backwards from the end.
    pub fn settling<'a>(&self, selection: &'a Selection) -> Settling<'a> {
        Settling::new(self, selection)
    }

    /// Turns any ids that have been given, raw or carried, into final ids. [`NONE`](crate::label::NONE) stays none.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub fn resolve(&mut self, ids: &mut [SegmentId], selection: &Selection) -> Result<()> {
        let mut becomes: FxHashMap<SegmentId, SegmentId> = FxHashMap::default();
        for run in ids.chunk_by(|a, b| a == b) {
            becomes.insert(run[0], run[0]);
        }
        self.settling(selection).rewind(self, 0, |id, settled| {
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

/// Where a record lies in the file.
fn place(record: u64) -> u64 {
    record * size_of::<[i64; 2]>() as u64
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn records_keep_what_they_tell() {
        let whole = |points, has_seed| Record::Closing(Closed { id: 7, points, has_seed });
        for record in [
            Record::Births { first: 1 },
            Record::Join { id: 9, becomes: 3 },
            whole(0, true),
            whole(0, false),
            whole(1 << 62, true),
            whole(1 << 62, false),
            Record::Reopening { id: 7 },
        ] {
            assert_eq!(Record::from(<[i64; 2]>::from(record)), record);
        }
    }

    #[test]
    fn closed_wholes_are_found_on_disk_and_in_memory() {
        let mut log = Aliases::default();
        let count = 2 * BLOCK as i64 + 5;
        for id in 1..=count {
            log.join(id + 1, id);
            log.close(&Closed { id, points: id as u64, has_seed: id % 2 == 0 });
        }
        assert!(log.written > 0 && !log.newest.is_empty());
        let mut closed = Vec::new();
        log.for_each_closed(|whole| closed.push(*whole)).unwrap();
        closed.sort_unstable_by_key(|whole| whole.id);
        assert!(closed.iter().zip(1..).all(|(whole, id)| whole.id == id && whole.points == id as u64));
        assert_eq!(closed.len() as i64, count);
        assert!(closed.iter().all(|whole| whole.has_seed == (whole.id % 2 == 0)));
    }
}
