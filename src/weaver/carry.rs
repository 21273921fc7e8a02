//! Carries segment ids over from window to window, on the fly.
//!
//! Segments that share points are one; the id of the whole is the smallest of theirs, so it is the one that is carried
//! (moving-window segmentation, ISPRS Annals I-3, 2012, section 2.2.3). Two wholes whose ids have both been handed out already can meet later, at the bottom of a
//! "U"; their join then comes with an *alias*, larger id → smaller id, so that none is lost.
//!
//! Only segments in scope are held: union-find over the consecutive ids from the oldest segment in scope to the newest.

use crate::label::SegmentId;

/// Which whole each segment in scope belongs to.
#[derive(Debug)]
pub struct Carry {
    /// The id of the first segment held.
    base: SegmentId,
    /// Union-find over `base..`; a parent is never larger than its child.
    parent: Vec<u32>,
    /// For representatives: the id of their whole, and whether it has been handed out.
    whole: Vec<(SegmentId, bool)>,
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
        Self { base: 1, parent: Vec::new(), whole: Vec::new() }
    }
}

impl Carry {
    /// The id that the next new segment gets.
    pub fn next_id(&self) -> SegmentId {
        self.base + self.parent.len() as i64
    }

    /// Takes in `count` new segments, each a whole of its own.
    pub fn extend(&mut self, count: usize) {
        let (first, id) = (self.parent.len() as u32, self.next_id());
        self.parent.extend(first..first + count as u32);
        self.whole.extend((id..id + count as i64).map(|id| (id, false)));
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

    /// Makes the wholes of two segments one; none if they already are.
    pub fn join(&mut self, a: SegmentId, b: SegmentId) -> Option<Join> {
        let (a, b) = (self.position(a), self.position(b));
        let (a, b) = (self.find(a), self.find(b));
        if a == b {
            return None;
        }
        let (kept, lost) = if a < b { (a, b) } else { (b, a) };
        self.parent[lost as usize] = kept;
        let (first, second) = (self.whole[kept as usize], self.whole[lost as usize]);
        let (winner, loser) = if first.0 < second.0 { (first, second) } else { (second, first) };
        // An alias names the winner, so the winner's own end has to be told as well.
        self.whole[kept as usize] = (winner.0, winner.1 || loser.1);
        Some(Join { id: loser.0, becomes: winner.0, is_alias: loser.1 })
    }

    /// The id that is carried for a segment, about to be handed out.
    pub fn hand_out(&mut self, segment_id: SegmentId) -> SegmentId {
        let representative = self.find(self.position(segment_id));
        let whole = &mut self.whole[representative as usize];
        whole.1 = true;
        whole.0
    }

    /// Forgets the segments before `segment_id`, none of which is in scope any more.
    pub fn evict_before(&mut self, segment_id: SegmentId) {
        let segment_id = segment_id.min(self.next_id());
        let leaving = self.position(segment_id);
        if leaving == 0 {
            return;
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
        self.parent = parent;
        self.whole.drain(..leaving as usize);
        self.base = segment_id;
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
        carry.extend(2);
        assert_eq!((carry.hand_out(1), carry.hand_out(2)), (1, 2));
        carry.extend(2);
        assert_eq!(carry.join(2, 3), Some(Join { id: 3, becomes: 2, is_alias: false }));
        assert_eq!(carry.join(3, 1), Some(Join { id: 2, becomes: 1, is_alias: true }));
        assert_eq!(carry.join(2, 1), None);
        assert_eq!((carry.hand_out(3), carry.hand_out(4)), (1, 4));
    }

    proptest! {
        /// Against a map from every id ever given to its whole, though the carry forgets the old ones.
        #[test]
        fn equals_never_forgetting(
            steps in prop::collection::vec((0usize..4, prop::collection::vec((0usize..99, 0usize..99), 0..4), 0usize..3), 1..60)
        ) {
            let mut carry = Carry::default();
            let mut of: HashMap<i64, i64> = HashMap::new();
            let mut base = 1;
            for (new, joins, leaving) in steps {
                let first = carry.next_id();
                carry.extend(new);
                of.extend((first..first + new as i64).map(|id| (id, id)));
                let held = (carry.next_id() - base) as usize;
                for (a, b) in joins.into_iter().filter(|_| held > 0) {
                    let (a, b) = (base + (a % held) as i64, base + (b % held) as i64);
                    let (p, q) = (of[&a].min(of[&b]), of[&a].max(of[&b]));
                    let joined = carry.join(a, b).map(|join| (join.becomes, join.id));
                    prop_assert_eq!(joined, (p != q).then_some((p, q)));
                    of.values_mut().filter(|whole| **whole == q).for_each(|whole| *whole = p);
                }
                base = (base + leaving as i64).min(carry.next_id());
                carry.evict_before(base);
                for id in base..carry.next_id() {
                    prop_assert_eq!(carry.hand_out(id), of[&id]);
                }
            }
        }
    }
}
