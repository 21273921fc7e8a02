//! What became of segments that have gone out of scope, for those that may still be joined.
//!
//! Two segments are found to be one when a window shows them share points. Sometimes that is found later, when they have
//! gone: a pair at the border of a window could not be decided before more had been seen, or the stream has come back to where it was. Such a *late join* needs to
//! know the whole that each segment belongs to, and how many points that whole had.
//!
//! Ids point to the smaller id that they have become, as in the log of joins ([`Aliases`](super::Aliases)). Who is remembered is said
//! beforehand: nobody, those that are [awaited](OutOfScope::awaited), or [all](OutOfScope::all), most of whom are kept on disk.

use rustc_hash::{FxHashMap, FxHashSet};

use super::Closed;
use super::ledger::Ledger;
use crate::error::Result;
use crate::label::SegmentId;

/// So many ids, and those that go out of scope with a window, are remembered in memory before they go to disk.
const MOST_IN_MEMORY: usize = 1 << 16;

/// What became of an id.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// It is no whole of its own any more.
    Became(SegmentId),
    /// It is the id of a whole that no window can touch.
    Closed { points: u64, has_seed: bool },
    /// It is the id of a whole that had been closed.
    Open,
}

/// Remembers what became of segments out of scope.
#[derive(Debug, Default)]
pub struct OutOfScope {
    who: Who,
    /// The newest fates; those on disk are older.
    fates: FxHashMap<SegmentId, Fate>,
    most_in_memory: usize,
}

/// Who is remembered.
#[derive(Debug, Default)]
enum Who {
    #[default]
    Nobody,
    /// Ids that are awaited, and those that they have become.
    Awaited(FxHashSet<SegmentId>),
    /// All, on disk once there are many.
    All(Option<Ledger>),
}

impl OutOfScope {
    /// Remembers those that are awaited.
    pub fn awaited() -> Self {
        Self { who: Who::Awaited(FxHashSet::default()), ..Self::default() }
    }

    /// Remembers all.
    pub fn all() -> Self {
        Self::all_but_few_on_disk(MOST_IN_MEMORY)
    }

    /// Remembers all, so many of them in memory.
    pub fn all_but_few_on_disk(most_in_memory: usize) -> Self {
        Self { who: Who::All(None), fates: FxHashMap::default(), most_in_memory }
    }

    /// Whether somebody is remembered.
    pub(super) fn remembers(&self) -> bool {
        !matches!(self.who, Who::Nobody)
    }

    /// Says anew who is awaited, and forgets the others. Without an effect where all are remembered.
    pub(super) fn await_only(&mut self, ids: &[SegmentId]) {
        let Who::Awaited(known) = &mut self.who else { return };
        let fates = std::mem::take(&mut self.fates);
        known.clear();
        for &awaited in ids {
            let mut id = awaited;
            while known.insert(id)
                && let Some(&fate) = fates.get(&id)
            {
                self.fates.insert(id, fate);
                let Fate::Became(next) = fate else { break };
                id = next;
            }
        }
    }

    /// Whether it matters what becomes of the id.
    fn knows(&self, id: SegmentId) -> bool {
        match &self.who {
            Who::Nobody => false,
            Who::Awaited(known) => known.contains(&id),
            Who::All(_) => true,
        }
    }

    /// Notes that an id has become another.
    pub(super) fn became(&mut self, id: SegmentId, becomes: SegmentId) {
        if id != becomes && self.knows(id) {
            if let Who::Awaited(known) = &mut self.who {
                known.insert(becomes);
            }
            self.note(id, Fate::Became(becomes));
        }
    }

    /// Notes that no window can touch a whole.
    pub(super) fn close(&mut self, &Closed { id, points, has_seed }: &Closed) {
        if self.knows(id) {
            self.note(id, Fate::Closed { points, has_seed });
        }
    }

    fn note(&mut self, id: SegmentId, fate: Fate) {
        self.fates.insert(id, fate);
    }

    /// Writes what is noted to disk, if it is much.
    ///
    /// # Errors
    /// If it cannot be written. Then what has been written before is lost, too, and no late join can be made any more.
    pub(super) fn spill(&mut self) -> Result<()> {
        if let Who::All(ledger) = &mut self.who
            && self.fates.len() >= self.most_in_memory
        {
            write(ledger, &self.fates)?;
            self.fates.clear();
        }
        Ok(())
    }

    fn fate(&self, id: SegmentId) -> Result<Option<Fate>> {
        match (self.fates.get(&id), &self.who) {
            (Some(&fate), _) => Ok(Some(fate)),
            (None, Who::All(Some(ledger))) => ledger.fate(id),
            (None, _) => Ok(None),
        }
    }

    /// What an id has become; none if it is a whole's.
    pub(super) fn next(&self, id: SegmentId) -> Result<Option<SegmentId>> {
        Ok(match self.fate(id)? {
            Some(Fate::Became(next)) => Some(next),
            _ => None,
        })
    }

    /// Opens a closed whole again; none if it is not remembered.
    pub(super) fn reopen(&mut self, id: SegmentId) -> Result<Option<Closed>> {
        Ok(match self.fate(id)? {
            Some(Fate::Closed { points, has_seed }) => {
                self.note(id, Fate::Open);
                Some(Closed { id, points, has_seed })
            }
            _ => None,
        })
    }
}

/// Writes fates to disk, by id, which is how they lie there.
fn write(ledger: &mut Option<Ledger>, fates: &FxHashMap<SegmentId, Fate>) -> Result<()> {
    let ledger = match ledger {
        Some(ledger) => ledger,
        none => none.insert(Ledger::new()?),
    };
    let mut fates: Vec<(SegmentId, Fate)> = fates.iter().map(|(&id, &fate)| (id, fate)).collect();
    fates.sort_unstable_by_key(|(id, _)| *id);
    ledger.note(fates.into_iter())
}
