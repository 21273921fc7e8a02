//! What became of segments that have gone out of scope, for those that may still be joined.
//!
//! Two segments are found to be one when a window shows them share points. Sometimes that is found later, when they have
//! gone: a pair at the border of a window could not be decided before more had been seen, or the stream has come back to where it was. Such a *late join* needs to
//! know the whole that each segment belongs to, and how many points that whole had.
//!
//! Ids point to the smaller id that they have become, as in the log of joins ([`Aliases`](super::Aliases)). Who is remembered is said
//! beforehand: nobody, those that are [awaited](OutOfScope::awaited), or [all](OutOfScope::all).

use rustc_hash::{FxHashMap, FxHashSet};

use super::Closed;
use crate::label::SegmentId;

/// What became of an id.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    /// It is no whole of its own any more.
    Became(SegmentId),
    /// It is the id of a whole that no window can touch.
    Closed { points: u64, has_seed: bool },
}

/// Remembers what became of segments out of scope.
#[derive(Debug, Default)]
pub struct OutOfScope {
    who: Who,
    fates: FxHashMap<SegmentId, Fate>,
}

/// Who is remembered.
#[derive(Debug, Default)]
enum Who {
    #[default]
    Nobody,
    /// Ids that are awaited, and those that they have become.
    Awaited(FxHashSet<SegmentId>),
    All,
}

impl OutOfScope {
    /// Remembers those that are awaited.
    pub fn awaited() -> Self {
        Self { who: Who::Awaited(FxHashSet::default()), fates: FxHashMap::default() }
    }

    /// Remembers all.
    pub fn all() -> Self {
        Self { who: Who::All, fates: FxHashMap::default() }
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
            Who::All => true,
        }
    }

    /// Notes that an id has become another.
    pub(super) fn became(&mut self, id: SegmentId, becomes: SegmentId) {
        if id != becomes && self.knows(id) {
            if let Who::Awaited(known) = &mut self.who {
                known.insert(becomes);
            }
            self.fates.insert(id, Fate::Became(becomes));
        }
    }

    /// Notes that no window can touch a whole.
    pub(super) fn close(&mut self, &Closed { id, points, has_seed }: &Closed) {
        if self.knows(id) {
            self.fates.insert(id, Fate::Closed { points, has_seed });
        }
    }

    /// What an id has become; none if it is a whole's.
    pub(super) fn next(&self, id: SegmentId) -> Option<SegmentId> {
        match self.fates.get(&id) {
            Some(Fate::Became(next)) => Some(*next),
            _ => None,
        }
    }

    /// Opens a closed whole again; none if it is not remembered.
    pub(super) fn reopen(&mut self, id: SegmentId) -> Option<Closed> {
        match self.fates.get(&id) {
            Some(&Fate::Closed { points, has_seed }) => {
                self.fates.remove(&id);
                Some(Closed { id, points, has_seed })
            }
            _ => None,
        }
    }

    /// How many ids are remembered.
    pub fn len(&self) -> usize {
        self.fates.len()
    }

    /// Whether nothing is remembered.
    pub fn is_empty(&self) -> bool {
        self.fates.is_empty()
    }
}
