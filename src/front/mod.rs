//! The FRONT: what the windows so far have left open of the whole cloud's Delaunay graph, decided as the stream moves on.
//!
//! Source: streaming computation of Delaunay triangulations (Isenburg, Liu, Shewchuk and Snoeyink 2006), which keeps those
//! triangles that a later point may still destroy. Departure: it is edges that are to be decided, the windows triangulate
//! themselves, side by side, and what is kept are places, triangulated again for each window. Window by window:
//!
//! 1. *Take in.* The front's places F are joined by the window's new ones that are open ([`Finality`]): F ∪ N. Sleeping
//!    places are put back into F if one of N lies strictly beyond their line. What has waited goes on waiting, except between
//!    places that the window holds both; of them it knows better. The window's open edges with a new end begin to wait.
//! 2. *Judge.* F ∪ N is triangulated, with nothing below and the window's border above. What waits and has no empty circle
//!    there is no edge of the cloud; what has one below the border is; the rest waits on.
//! 3. *Retire.* The places that are not open in that triangulation are forgotten. Those that are open only beyond a straight
//!    part of the hull ([`Opening`]) *sleep*: they are put aside, line by line, and are triangulated no more.
//!
//! Why F ∪ N is enough, if nothing sleeps. Let P be all places so far, C the triangulation of P, and call a place *closed* if
//! it is in P but not in F ∪ N: all its triangles in C were final, in this window or below the last one's border. F ∪ N has
//! triangles that C has not, over closed territory, but only pairs that wait are ever looked at, and for them both agree:
//!
//! * If a waiting pair pq is an edge of C it has an empty circle in F ∪ N, too. If it is not, let p be the end that is new,
//!   or that the window does not hold, if there is one. The segment from p to q starts into a triangle T of C. If no corner of
//!   T is closed, T is in F ∪ N and bars the way to q. If one is, T is final:
//!   - In the window. Then the window holds p, and so q, too; pq is an edge of its triangulation, and cannot cross T,
//!     unless q is on T's circle. But then the window saw that pq is final, and it would not wait.
//!   - Below the last border. Then p is not new, and neither is q; pq has waited, was an edge of the last C, and cannot cross T,
//!     unless q is on T's circle. But then it was decided when the first corner of that circle was closed, at the latest.
//! * The circles that decide about an edge pq of C are those between its two triangles there. For the same reasons
//!   no third corner of these is closed, so they are the two triangles at pq in F ∪ N.
//! * A corner of a triangle of C that is not final is not closed. So what is open in C is open in F ∪ N, and in F after that.
//!
//! An edge that has no new end has had its verdict, or waits. So every edge waits once at the most, and when nothing more
//! can come every circle is final: nothing is left undecided. This presumes that every pair that matters shares a window.
//!
//! Why places may sleep. Where s falls asleep, it is no corner of the hull of F ∪ N, which is that of P, and no corner of a
//! triangle of C that is not final, because those are triangles of F ∪ N. So in C, too, s has only final triangles, and lies
//! between two neighbors on a straight part of the hull. From then on it keeps all of these as long as nothing of P lies
//! strictly beyond the line. The first to do so is new, and the farthest of them is on the hull of its window, and so in N:
//! then s is back in time, by the exact predicate (Shewchuk 1997). Till then the above holds of s as of a place closed below
//! the last border: what has a triangle or an edge in common with s was in P when s fell asleep, and what waited there has
//! been decided, at the latest, when it did. (So it is, too, if the way from p to q does not start into a triangle of C but
//! along one of its edges.) Where all of P is on one line, edges stand for triangles, and either side is beyond.
//!
//! Kept awake are the places along the border, the corners of the cloud's hull, and those around what is empty and reaches past
//! the border, which may be a sliver along the hull. The edge of a grid sleeps, and takes 16 bytes a place.

mod asleep;
mod frontier;

use rustc_hash::FxHashSet;

pub use frontier::{Frontier, OpenEdge, Place};

use crate::label::SegmentId;
use crate::neighborhood::{Delaunay, Loaded, Opening};
use asleep::Asleep;

/// The open places of all windows so far, and the edges that wait to be decided.
#[derive(Debug, Default)]
pub struct Front {
    places: Vec<[f64; 2]>,
    asleep: Asleep,
    waiting: Vec<Waiting>,
    /// Spans before this one have been loaded.
    next_span: u64,
    decided: u64,
}

/// Two segments that are one if two places are neighbors.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    ends: [Place; 2],
    segments: [SegmentId; 2],
}

impl Front {
    /// Takes the next window in, whose label 0 is the segment `first_segment_id`; returns pairs of segments that are one.
    pub fn advance(&mut self, frontier: &Frontier, first_segment_id: SegmentId) -> Vec<[SegmentId; 2]> {
        self.take_in(frontier, first_segment_id);
        self.judge(Loaded { low: f64::NEG_INFINITY, ..frontier.loaded })
    }

    /// Decides all that waits, because nothing more will come; returns pairs of segments that are one.
    pub fn finish(&mut self) -> Vec<[SegmentId; 2]> {
        self.judge(Loaded { direction: [1.0, 0.0], low: f64::NEG_INFINITY, high: f64::INFINITY, largest: 0.0 })
    }

    fn take_in(&mut self, frontier: &Frontier, first_segment_id: SegmentId) {
        let carried: FxHashSet<_> = self.waiting.iter().map(|edge| key(edge.ends)).collect();
        let mut begun = self.waiting.len();
        self.waiting.retain(|edge| edge.ends.iter().any(|end| end.span < frontier.spans.start));
        for edge in &frontier.edges {
            let is_new = edge.ends.iter().any(|end| end.span >= self.next_span);
            begun += usize::from(is_new);
            if is_new || carried.contains(&key(edge.ends)) {
                let segments = edge.labels.map(|label| first_segment_id + SegmentId::from(label));
                self.waiting.push(Waiting { ends: edge.ends, segments });
            }
        }
        self.decided += begun.saturating_sub(self.waiting.len()) as u64;
        let new = frontier.places.iter().filter(|place| place.span >= self.next_span);
        let new: Vec<[f64; 2]> = new.map(|place| place.at).collect();
        self.places.extend(self.asleep.wake(&new));
        self.places.extend(new);
        self.next_span = frontier.spans.end;
    }

    fn judge(&mut self, loaded: Loaded) -> Vec<[SegmentId; 2]> {
        if loaded.is_everything() {
            // What is beyond will stay empty.
            self.asleep = Asleep::default();
        }
        let neighborhood = Delaunay::new(&self.places, |_| 0.0);
        let finality = neighborhood.finality(loaded);
        let mut joins = Vec::new();
        let before = self.waiting.len();
        self.waiting.retain(|Waiting { ends: [p, q], segments }| match neighborhood.edge_between(p.at, q.at) {
            Some(edge) if edge.is_final(&finality) => {
                joins.push(*segments);
                false
            }
            edge => edge.is_some(),
        });
        self.decided += (before - self.waiting.len()) as u64;
        let mut open = Vec::new();
        neighborhood.for_each_open_stack(&finality, |stack, opening| {
            let place = self.places[neighborhood.order()[stack.start] as usize];
            match opening {
                Opening::Anywhere => open.push(place),
                Opening::LeftOf(_) | Opening::Beside(_) => self.asleep.put(place, opening),
            }
        });
        self.places = open;
        joins
    }

    /// The segments that a later window may join.
    pub fn awaited(&self) -> Vec<SegmentId> {
        self.waiting.iter().flat_map(|edge| edge.segments).collect()
    }

    /// How many pairs of points wait.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// How many pairs of points that waited have been decided, either way.
    pub fn decided(&self) -> u64 {
        self.decided
    }

    /// How many places are kept and triangulated again.
    pub fn places(&self) -> usize {
        self.places.len()
    }

    /// How many places sleep.
    pub fn asleep(&self) -> usize {
        self.asleep.len()
    }
}

/// The same for both directions of an edge.
fn key([p, q]: [Place; 2]) -> [[u64; 2]; 2] {
    let [p, q] = [p, q].map(|place| place.at.map(f64::to_bits));
    if p < q { [p, q] } else { [q, p] }
}
