//! The right half of the figure: labels of windows → WEAVER → spans with segment ids, and the joins that come late.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::late_joins::{LateJoins, Seen};
use super::outgoing::WovenWindow;
use super::planes::LivePlanes;
use crate::certificate::Certificate;
use crate::crew::Crew;
use crate::error::{Error, Result};
use crate::lattice::is_valid;
use crate::look::Look;
use crate::revisit::{Context, Revisit};
use crate::segmentor::{Plane, Segmented, Segmentor};
use crate::span::Span;
use crate::weaver::{Agreement, EvictedSpan, LabelledWindow, OutOfScope, Returned, Weaver};

/// Ties the windows' labels together.
pub(super) struct Weaving {
    segmentor: Arc<dyn Segmentor>,
    weaver: Weaver,
    late_joins: LateJoins,
    planes: LivePlanes,
    time: Duration,
}

/// What a window has come to; an error leaves the spans that went out of scope with it whole.
pub(super) struct Woven {
    pub window: WovenWindow,
    pub evicted: Vec<EvictedSpan>,
    pub failure: Option<Error>,
}

impl Weaving {
    pub fn new(segmentor: Arc<dyn Segmentor>, looks_again: bool) -> Self {
        let late_joins = LateJoins::new(segmentor.exactness(), looks_again);
        let weaver = Weaver::with_late_joins(late_joins.out_of_scope());
        Self { segmentor, weaver, late_joins, planes: LivePlanes::default(), time: Duration::ZERO }
    }

    /// Any segment may return.
    pub fn with_revisit(self) -> Self {
        Self { weaver: Weaver::with_late_joins(OutOfScope::all()), ..self }
    }

    /// Weaves the window `index` over `spans`, behind what was brought back for it.
    pub fn weave(
        &mut self,
        index: u64,
        spans: &[Arc<Span>],
        context: Option<&Context>,
        look: Look,
        revisit: Option<&mut Revisit>,
        crew: &Crew,
    ) -> Woven {
        let begun = Instant::now();
        let Look { segmented, sights, of_context } = look;
        let Segmented { labels, seeded, planes, undecided, mut tally, frontier } = segmented;
        tally.returned_points += of_context.len() as u64;
        if self.may_come_back_to(spans, revisit.is_some()) {
            let valid = spans.iter().flat_map(|span| &span.points).filter(|point| is_valid(point)).count();
            tally.early_decisions += (valid - undecided.map_or(0, |points| points.len())) as u64;
        }
        let span_points: Vec<usize> = spans.iter().map(|span| span.len()).collect();
        let first_span = spans.first().map_or(0, |span| span.index);
        let first_segment_id = self.weaver.next_id();
        let returned = self.returned(context, &of_context, planes.as_deref(), revisit);
        let evicted = {
            let agrees = planes.as_ref().map(|planes| self.planes.agreement(&*self.segmentor, planes));
            let agrees = agrees.as_ref().map(|agrees| agrees as &Agreement);
            let seeded = seeded.as_deref();
            let window =
                LabelledWindow { index, first_span, span_points: &span_points, labels: &labels, seeded, agrees };
            self.weaver.weave(&window, crew)
        };
        let seen =
            Seen { window: index, first_segment_id, frontier: frontier.as_ref(), sights: &sights, evicted: &evicted };
        let joined = returned
            .and_then(|returned| self.weaver.join_returned(&returned, first_segment_id, index))
            .and_then(|()| self.late_joins.join(&seen, &mut self.weaver, &mut tally));
        self.planes.take_in(first_segment_id, planes.unwrap_or_default(), self.weaver.oldest_live_id());
        self.time += begun.elapsed();
        let points = span_points.iter().sum();
        let (spans, segments) = (spans.len(), labels.count());
        let window = WovenWindow { index, first_span, spans, points, first_segment_id, segments, tally };
        Woven { window, evicted, failure: joined.err() }
    }

    /// The earlier segments that came back with the context of a window, and are to be one with its labels.
    fn returned(
        &self,
        context: Option<&Context>,
        labels: &[i32],
        planes: Option<&[Plane]>,
        revisit: Option<&mut Revisit>,
    ) -> Result<Vec<Returned>> {
        let raw_id = |span, position| self.weaver.raw_id(span, position);
        let mut returned = context.map(|context| context.returned(labels, raw_id)).unwrap_or_default();
        if let (Some(revisit), Some(planes)) = (revisit, planes) {
            revisit.agreeing(&mut returned, &*self.segmentor, self.weaver.next_id(), planes)?;
        }
        Ok(returned)
    }

    /// Whether more of the cloud may come to where the spans are and undo what is decided now. Spans of space hold all that
    /// ever comes to their place; and where more points can only join more, and are brought together whenever they come,
    /// nothing is undone.
    fn may_come_back_to(&self, spans: &[Arc<Span>], revisits: bool) -> bool {
        let is_undone_by_none = revisits && self.segmentor.exactness().is_monotone();
        !is_undone_by_none && spans.iter().any(|span| span.extent.is_none())
    }

    /// Joins what still waits after the `last` window; returns the spans that are left.
    pub fn finish(&mut self, last: u64, certificate: &mut Certificate) -> (Vec<EvictedSpan>, Option<Error>) {
        let joined = self.late_joins.finish(last, &mut self.weaver, certificate);
        (self.weaver.finish(), joined.err())
    }

    pub fn take_in(&self, window: &WovenWindow, certificate: &mut Certificate) {
        certificate.take_in(window.tally, self.late_joins.edges_wait());
    }

    pub fn weaver(&self) -> &Weaver {
        &self.weaver
    }

    pub fn weaver_mut(&mut self) -> &mut Weaver {
        &mut self.weaver
    }

    /// How long it took so far.
    pub fn time(&self) -> Duration {
        self.time
    }
}
