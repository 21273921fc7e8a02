//! The planes of the segments in scope, where segments of two windows are one only if their planes agree.

use std::collections::VecDeque;

use crate::label::SegmentId;
use crate::segmentor::{Plane, Segmentor};

/// Planes by segment id.
#[derive(Default)]
pub(super) struct LivePlanes {
    /// The segment of the first plane; those of the next ids follow.
    oldest: SegmentId,
    planes: VecDeque<Plane>,
}

impl LivePlanes {
    /// Whether a segment in scope and a label of the window whose planes are `newest` agree.
    pub fn agreement(&self, segmentor: &dyn Segmentor, newest: &[Plane]) -> impl Fn(SegmentId, i32) -> bool + Sync {
        move |segment_id, label| {
            let earlier = self.planes.get((segment_id - self.oldest) as usize);
            earlier.zip(newest.get(label as usize)).is_none_or(|(earlier, later)| segmentor.agree(earlier, later))
        }
    }

    /// Takes in the planes of a window's segments, whose ids start from `first`, and forgets those of segments older than
    /// `oldest_live`.
    pub fn take_in(&mut self, first: SegmentId, newest: Vec<Plane>, oldest_live: SegmentId) {
        if self.planes.is_empty() {
            self.oldest = first;
        }
        self.planes.extend(newest);
        let forgotten = (oldest_live - self.oldest).clamp(0, self.planes.len() as i64);
        self.planes.drain(..forgotten as usize);
        self.oldest += forgotten;
    }
}
