//! Joins of segments that no window has shown by points of its own: what neighbors farther apart than windows overlap, and
//! edges that had to wait, make one.

use crate::certificate::{Certificate, Tally};
use crate::error::Result;
use crate::front::{Front, Frontier};
use crate::label::SegmentId;
use crate::look::{Sight, sees_beyond};
use crate::segmentor::Exactness;
use crate::sightings::Sightings;
use crate::weaver::{EvictedSpan, OutOfScope, Weaver};

/// What has been seen so far and may still join segments, as the segmentor's promise asks for it.
pub(super) enum LateJoins {
    /// Neighbors share a window, and it decides about them.
    None,
    /// Windows leave edges open.
    Front(Front),
    /// Neighbors may share no window.
    Sightings(Sightings),
}

/// A window that has been woven, as far as late joins depend on it.
pub(super) struct Seen<'a> {
    pub window: u64,
    pub first_segment_id: SegmentId,
    pub frontier: Option<&'a Frontier>,
    pub sights: &'a [Sight],
    pub evicted: &'a [EvictedSpan],
}

impl LateJoins {
    /// Nothing seen yet; points that are far away are seen if the segmentor `looks_again`.
    pub fn new(exactness: Exactness, looks_again: bool) -> Self {
        match exactness {
            Exactness::Proven { .. } => Self::Front(Front::default()),
            _ if sees_beyond(exactness) => Self::Sightings(Sightings::new(looks_again)),
            _ => Self::None,
        }
    }

    /// What has to be remembered of segments that have gone out of scope.
    pub fn out_of_scope(&self) -> OutOfScope {
        match self {
            Self::None => OutOfScope::default(),
            Self::Front(_) => OutOfScope::awaited(),
            Self::Sightings(sightings) => sightings.out_of_scope(),
        }
    }

    /// Whether edges that a window could not decide wait for later ones.
    pub fn edges_wait(&self) -> bool {
        matches!(self, Self::Front(_))
    }

    /// Joins what a window that has just been woven decides of what it and those before it left open.
    pub fn join(&mut self, seen: &Seen<'_>, weaver: &mut Weaver, tally: &mut Tally) -> Result<()> {
        match (self, seen.frontier) {
            (Self::Sightings(sightings), _) => {
                sightings.join(seen.sights, seen.first_segment_id, seen.window, seen.evicted, weaver)
            }
            (Self::Front(front), Some(frontier)) => {
                let decided = front.decided();
                let joins = front.advance(frontier, seen.first_segment_id);
                tally.decided_edges += front.decided() - decided;
                tally.waiting_edges = front.waiting() as u64;
                weaver.join_late(&joins, seen.window)?;
                weaver.await_segments(&front.awaited());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Joins, with the last window, what waits when nothing more can come.
    pub fn finish(&mut self, last: u64, weaver: &mut Weaver, certificate: &mut Certificate) -> Result<()> {
        let Self::Front(front) = self else { return Ok(()) };
        weaver.join_late(&front.finish(), last)?;
        certificate.decided_edges += std::mem::take(&mut certificate.undecided_edges);
        Ok(())
    }
}
