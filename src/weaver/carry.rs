//! Carries segment ids over from window to window, on the fly.
//!
//! Segments that share points are one; the id of the whole is the smallest of theirs, so it is the one that is carried
//! (moving-window segmentation, ISPRS Annals I-3, 2012, section 2.2.3). Two wholes whose ids have both been handed out already can meet later, at the bottom of a
//! "U"; their join then comes with an *alias*, larger id → smaller id, so that none is lost.
//!
//! Only segments in scope are held: union-find over the consecutive ids from the oldest segment in scope to the newest.
//! When the last segment of a whole is forgotten the whole is *closed*: its id and its size are final. A point counts
//! when it is handed out, so once, whenever it got its label. A closed whole can be joined again if it is remembered
//! ([`OutOfScope`]); it is open then, until it is closed once more.

use rustc_hash::FxHashMap;

use super::OutOfScope;
use crate::error::{Error, Result};
use crate::label::SegmentId;

/// Which whole each segment in scope belongs to.
#[derive(Debug)]
pub struct Carry {
    /// The id of the first segment held.
    base: SegmentId,
    /// Union-find over `base..`; a parent is never larger than its child.
    parent: Vec<u32>,
    /// For representatives: what is known of their whole.
    whole: Vec<Whole>,
    /// Representatives of the wholes whose ids are older than `base`, while segments out of scope are remembered.
    elders: FxHashMap<SegmentId, u32>,
    out_of_scope: OutOfScope,
}

#[derive(Debug, Clone, Copy)]
struct Whole {
    id: SegmentId,
    /// How many of its points have been handed out.
    points: u64,
    is_handed_out: bool,
    has_seed: bool,
}

/// A whole that no later window can touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Closed {
    /// Its final id, the smallest of its segments'.
    pub id: SegmentId,
    /// How many points it has.
    pub points: u64,
    /// Whether it may be kept where seeds are asked for.
    pub has_seed: bool,
}

impl Whole {
    fn closed(&self) -> Closed {
        Closed { id: self.id, points: self.points, has_seed: self.has_seed }
    }
}

/// Two wholes that became one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Join {
    /// The larger id, which is not carried any further.
    pub id: SegmentId,
    /// The smaller one, which is.
    pub becomes: SegmentId,
    /// Whether points have already been handed out under the larger id.
    pub is_alias: bool,
}

impl Default for Carry {
    fn default() -> Self {
        Self::new(OutOfScope::default())
    }
}

/// Where a segment's whole is to be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// In scope: its representative.
    InScope(u32),
    /// Closed: its id.
    Closed(SegmentId),
}

/// What a late join did, in this order.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct LateJoin {
    /// Wholes that had been closed and are open again.
    pub reopened: Vec<SegmentId>,
    /// The wholes that became one; none if they were one already.
    pub join: Option<Join>,
    /// The new whole, if no window can touch it.
    pub closed: Option<Closed>,
}

impl Carry {
    /// With no segments, and what is to be known of those that go out of scope.
    pub fn new(out_of_scope: OutOfScope) -> Self {
        Self { base: 1, parent: Vec::new(), whole: Vec::new(), elders: FxHashMap::default(), out_of_scope }
    }

    /// Says anew which segments may be joined after they have gone out of scope.
    pub fn await_only(&mut self, ids: &[SegmentId]) {
        self.out_of_scope.await_only(ids);
    }

    /// Writes to disk what is remembered of segments that have gone out of scope, if it is much.
    ///
    /// # Errors
    /// If that cannot be written; no late join can be made then.
    pub fn spill(&mut self) -> Result<()> {
        self.out_of_scope.spill()
    }

    /// The id that the next new segment gets.
    pub fn next_id(&self) -> SegmentId {
        self.base + self.parent.len() as i64
    }

    /// Takes in `count` new segments, each a whole of its own, with seeds or without.
    pub fn extend(&mut self, count: usize, has_seed: bool) {
        let (first, id) = (self.parent.len() as u32, self.next_id());
        self.parent.extend(first..first + count as u32);
        let whole = |id| Whole { id, points: 0, is_handed_out: false, has_seed };
        self.whole.extend((id..id + count as i64).map(whole));
    }

    /// Notes that a segment holds a seed.
    pub fn seed(&mut self, segment_id: SegmentId) {
        let representative = self.find(self.position(segment_id));
        self.whole[representative as usize].has_seed = true;
    }

    fn find(&mut self, segment: u32) -> u32 {
        let mut at = segment;
        while self.parent[at as usize] != at {
            // Halve the path on the way.
            let parent = self.parent[at as usize];
            self.parent[at as usize] = self.parent[parent as usize];
            at = self.parent[at as usize];
        }
        at
    }

    fn position(&self, segment_id: SegmentId) -> u32 {
        (segment_id - self.base) as u32
    }

    /// Makes the wholes of two segments in scope one; none if they already are.
    pub fn join(&mut self, a: SegmentId, b: SegmentId) -> Option<Join> {
        let (a, b) = (self.position(a), self.position(b));
        let (a, b) = (self.find(a), self.find(b));
        self.join_in_scope(a, b)
    }

    /// Makes the wholes of two segments one, whether they are in scope or not.
    ///
    /// # Errors
    /// If one is out of scope and not remembered.
    pub fn join_late(&mut self, a: SegmentId, b: SegmentId) -> Result<LateJoin> {
        let (a, b) = (self.locate(a)?, self.locate(b)?);
        let (older, id) = match (a, b) {
            _ if a == b => return Ok(LateJoin::default()),
            (Place::InScope(a), Place::InScope(b)) => {
                return Ok(LateJoin { join: self.join_in_scope(a, b), ..LateJoin::default() });
            }
            (older, Place::Closed(id)) | (Place::Closed(id), older) => (older, id),
        };
        let closed = self.reopen(id)?;
        Ok(match older {
            Place::InScope(representative) => {
                let join = self.join_closed(representative, &closed);
                LateJoin { reopened: vec![id], join: Some(join), closed: None }
            }
            Place::Closed(other) => {
                let (winner, loser) =
                    if other < id { (self.reopen(other)?, closed) } else { (closed, self.reopen(other)?) };
                self.out_of_scope.became(loser.id, winner.id);
                let points = winner.points + loser.points;
                let whole = Closed { id: winner.id, points, has_seed: winner.has_seed || loser.has_seed };
                self.out_of_scope.close(&whole);
                let join = Join { id: loser.id, becomes: winner.id, is_alias: true };
                LateJoin { reopened: vec![id, other], join: Some(join), closed: Some(whole) }
            }
        })
    }

    fn reopen(&mut self, id: SegmentId) -> Result<Closed> {
        self.out_of_scope.reopen(id)?.ok_or(Error::OutOfScope { segment_id: id })
    }

    /// Where the whole of a segment is.
    fn locate(&mut self, segment_id: SegmentId) -> Result<Place> {
        let mut id = segment_id;
        loop {
            if id >= self.base {
                return Ok(Place::InScope(self.find(self.position(id))));
            }
            if let Some(&elder) = self.elders.get(&id) {
                return Ok(Place::InScope(self.find(elder)));
            }
            match self.out_of_scope.next(id)? {
                Some(next) => id = next,
                None => return Ok(Place::Closed(id)),
            }
        }
    }

    /// Makes a whole in scope and one that had been closed one.
    fn join_closed(&mut self, representative: u32, closed: &Closed) -> Join {
        let whole = &mut self.whole[representative as usize];
        let open_id = whole.id;
        let is_older = closed.id < open_id;
        let (id, becomes) = if is_older { (open_id, closed.id) } else { (closed.id, open_id) };
        let is_alias = if is_older { whole.is_handed_out } else { true };
        *whole = Whole {
            id: becomes,
            points: whole.points + closed.points,
            is_handed_out: true,
            has_seed: whole.has_seed || closed.has_seed,
        };
        self.lose_name(id, becomes, representative);
        Join { id, becomes, is_alias }
    }

    /// Notes that a whole in scope goes by an older name.
    fn lose_name(&mut self, id: SegmentId, becomes: SegmentId, representative: u32) {
        if self.out_of_scope.remembers() {
            if id < self.base {
                self.elders.remove(&id);
                self.out_of_scope.became(id, becomes);
            }
            if becomes < self.base {
                self.elders.insert(becomes, representative);
            }
        }
    }

    fn join_in_scope(&mut self, a: u32, b: u32) -> Option<Join> {
        if a == b {
            return None;
        }
        let (kept, lost) = if a < b { (a, b) } else { (b, a) };
        self.parent[lost as usize] = kept;
        let (first, second) = (self.whole[kept as usize], self.whole[lost as usize]);
        let (winner, loser) = if first.id < second.id { (first, second) } else { (second, first) };
        self.whole[kept as usize] = Whole {
            id: winner.id,
            points: winner.points + loser.points,
            // An alias names the winner, so the winner's own end has to be told as well.
            is_handed_out: winner.is_handed_out || loser.is_handed_out,
            has_seed: winner.has_seed || loser.has_seed,
        };
        self.lose_name(loser.id, winner.id, kept);
        Some(Join { id: loser.id, becomes: winner.id, is_alias: loser.is_handed_out })
    }

    /// The id that is carried for a segment, about to be handed out with so many points that go out of scope.
    pub fn hand_out(&mut self, segment_id: SegmentId, points: usize) -> SegmentId {
        let representative = self.find(self.position(segment_id));
        let whole = &mut self.whole[representative as usize];
        whole.points += points as u64;
        whole.is_handed_out = true;
        whole.id
    }

    /// Forgets the segments before `segment_id`, none of which is in scope any more; returns the wholes that are closed
    /// by that.
    pub fn evict_before(&mut self, segment_id: SegmentId) -> Vec<Closed> {
        let segment_id = segment_id.min(self.next_id());
        let leaving = self.position(segment_id);
        if leaving == 0 {
            return Vec::new();
        }
        // Of each whole, the smallest segment that stays becomes the representative.
        let mut heir: Vec<Option<u32>> = vec![None; self.parent.len()];
        let mut parent = Vec::with_capacity(self.parent.len() - leaving as usize);
        for segment in leaving..self.parent.len() as u32 {
            let representative = self.find(segment) as usize;
            let heir = *heir[representative].get_or_insert(segment);
            self.whole[heir as usize] = self.whole[representative];
            parent.push(heir - leaving);
        }
        let is_closed = |segment: usize| self.parent[segment] == segment as u32 && heir[segment].is_none();
        let closed = (0..leaving as usize).filter(|&segment| is_closed(segment));
        let closed: Vec<Closed> = closed.map(|segment| self.whole[segment].closed()).collect();
        if self.out_of_scope.remembers() {
            self.remember(leaving, &parent, &closed);
        }
        self.parent = parent;
        self.whole.drain(..leaving as usize);
        self.base = segment_id;
        closed
    }

    /// Remembers what becomes of the first `leaving` segments.
    fn remember(&mut self, leaving: u32, heirs: &[u32], closed: &[Closed]) {
        for segment in 0..leaving {
            let representative = self.find(segment) as usize;
            self.out_of_scope.became(self.base + i64::from(segment), self.whole[representative].id);
        }
        for whole in closed {
            self.out_of_scope.close(whole);
        }
        let base = self.base + i64::from(leaving);
        let heads = (0..).zip(heirs).filter(|(segment, heir)| segment == *heir);
        let wholes = heads.map(|(segment, _)| (self.whole[(leaving + segment) as usize].id, segment));
        self.elders = wholes.filter(|(id, _)| *id < base).collect();
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    #[test]
    fn the_smallest_id_is_carried_and_a_late_join_is_an_alias() {
        let mut carry = Carry::default();
        carry.extend(2, true);
        assert_eq!((carry.hand_out(1, 1), carry.hand_out(2, 1)), (1, 2));
        carry.extend(2, true);
        assert_eq!(carry.join(2, 3), Some(Join { id: 3, becomes: 2, is_alias: false }));
        assert_eq!(carry.join(3, 1), Some(Join { id: 2, becomes: 1, is_alias: true }));
        assert_eq!(carry.join(2, 1), None);
        assert_eq!((carry.hand_out(3, 1), carry.hand_out(4, 1)), (1, 4));
    }

    #[test]
    fn a_whole_is_closed_with_its_last_segment_and_has_all_its_points_and_seeds() {
        let mut carry = Carry::default();
        carry.extend(4, false);
        carry.join(1, 3);
        for (segment, points) in [(1, 5), (2, 7), (3, 1), (1, 2)] {
            carry.hand_out(segment, points);
        }
        assert_eq!(carry.evict_before(3), [Closed { id: 2, points: 7, has_seed: false }]);
        carry.seed(3);
        carry.hand_out(3, 2);
        let rest = [Closed { id: 1, points: 10, has_seed: true }, Closed { id: 4, points: 0, has_seed: false }];
        assert_eq!(carry.evict_before(i64::MAX), rest);
        assert_eq!(carry.next_id(), 5);
    }

    proptest! {
        /// Against maps from every id ever given to its whole, its points and its seed, though the carry forgets the old.
        #[test]
        fn equals_never_forgetting(
            steps in prop::collection::vec(
                (0usize..4, prop::collection::vec((0usize..99, 0usize..99), 0..4), 0usize..3, any::<bool>()), 1..60
            )
        ) {
            let mut carry = Carry::default();
            let mut of: HashMap<i64, i64> = HashMap::new();
            let (mut points, mut seeds) = (HashMap::new(), Vec::new());
            let mut closed = Vec::new();
            let mut base = 1;
            for (new, joins, leaving, seeded) in steps {
                let first = carry.next_id();
                carry.extend(new, false);
                of.extend((first..first + new as i64).map(|id| (id, id)));
                if seeded && new > 0 {
                    carry.seed(first);
                    seeds.push(first);
                }
                let held = (carry.next_id() - base) as usize;
                for (a, b) in joins.into_iter().filter(|_| held > 0) {
                    let (a, b) = (base + (a % held) as i64, base + (b % held) as i64);
                    let (p, q) = (of[&a].min(of[&b]), of[&a].max(of[&b]));
                    let joined = carry.join(a, b).map(|join| (join.becomes, join.id));
                    prop_assert_eq!(joined, (p != q).then_some((p, q)));
                    of.values_mut().filter(|whole| **whole == q).for_each(|whole| *whole = p);
                }
                for id in base..carry.next_id() {
                    prop_assert_eq!(carry.hand_out(id, id as usize), of[&id]);
                    *points.entry(id).or_insert(0) += id as u64;
                }
                base = (base + leaving as i64).min(carry.next_id());
                closed.extend(carry.evict_before(base));
                let open = |closed: &Closed| (base..carry.next_id()).any(|id| of[&id] == closed.id);
                prop_assert!(!closed.iter().any(open));
            }
            closed.extend(carry.evict_before(i64::MAX));
            closed.sort_unstable_by_key(|whole| whole.id);
            let whole = |&id: &i64| Closed {
                id,
                points: points.iter().filter(|(part, _)| of[part] == id).map(|(_, points)| points).sum(),
                has_seed: seeds.iter().any(|part| of[part] == id),
            };
            let mut wholes: Vec<i64> = of.values().copied().collect();
            wholes.sort_unstable();
            wholes.dedup();
            prop_assert_eq!(closed, wholes.iter().map(whole).collect::<Vec<_>>());
        }
    }
}
