//! What comes out of a run, and how far it is.

use std::sync::Arc;
use std::time::Duration;

use crate::certificate::Tally;
use crate::label::SegmentId;
use crate::span::Span;
use crate::weaver::EvictedSpan;

/// A span that went out of scope, and what is known of it.
#[derive(Debug)]
pub struct Outgoing {
    /// The span as it came in.
    pub span: Arc<Span>,
    /// What the weaver knows of it.
    pub segmented: EvictedSpan,
    /// The windows woven since the last span came out.
    pub windows: Vec<WovenWindow>,
}

/// What became of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WovenWindow {
    /// Number of the window.
    pub index: u64,
    /// Its first span.
    pub first_span: u64,
    /// How many spans it has.
    pub spans: usize,
    /// How many points they have.
    pub points: usize,
    /// The id of its first segment; the others follow.
    pub first_segment_id: SegmentId,
    /// How many segments it has.
    pub segments: usize,
    /// What was decided with it.
    pub tally: Tally,
}

/// How far the run is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Progress {
    /// Points that have come out.
    pub points: u64,
    /// Windows woven.
    pub windows: u64,
    /// Segments in scope.
    pub live_segments: usize,
    /// Raw segment ids given.
    pub segment_ids: i64,
    /// Segments there are, as far as is known: raw ids less joins.
    pub segments: i64,
    /// Time the weaver has taken.
    pub weaving: Duration,
}
