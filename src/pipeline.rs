//! The framework's figure as code: spans → windows → SEGMENTOR → WEAVER → spans with segment ids.
//!
//! Source: moving-window segmentation (ISPRS Annals I-3, 2012, figure 1). [`Pipeline`] is an iterator: it asks the source
//! for a span only when it needs one. With one thread a span's labels come out as soon as the windows that could still
//! change its scope have been woven; each further thread reads one window ahead.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::certificate::{Certificate, Tally};
use crate::crew::{Crew, Job};
use crate::error::{Error, Result};
use crate::front::{Front, Frontier};
use crate::label::SegmentId;
use crate::lattice::Lattice;
use crate::look::{Look, LookAgain, look, sees_beyond};
use crate::revisit::{Context, Revisit};
use crate::segmentor::{Exactness, Plane, Segmented, Segmentor};
use crate::sightings::Sightings;
use crate::span::{Extent, Span, Spans, Waits};
use crate::undecided::Undecided;
use crate::weaver::{Agreement, Aliases, EvictedSpan, LabelledWindow, OutOfScope, Returned, Weaver};
use crate::window::{Slider, Window, WindowSize};

/// Called now and then with the progress so far; its error interrupts the run.
pub type LookUp = Box<dyn FnMut(&Progress) -> Result<()> + Send>;

/// Streams spans through a segmentor and the weaver.
pub struct Pipeline {
    spans: Option<Spans>,
    slider: Slider,
    /// Where points that have gone out of scope come back.
    revisit: Option<Revisit>,
    segmentor: Arc<dyn Segmentor>,
    crew: Crew,
    under_way: VecDeque<SegmentedWindow>,
    weaver: Weaver,
    /// Spans of woven windows, in scope.
    live: VecDeque<Arc<Span>>,
    ready: VecDeque<Outgoing>,
    /// Windows that no span has told yet.
    untold: Vec<WovenWindow>,
    failure: Option<Error>,
    finished: bool,
    look_up: LookUp,
    progress: Progress,
    planes: LivePlanes,
    certificate: Certificate,
    undecided: Undecided,
    /// Where neighbors may share no window.
    sightings: Option<Sightings>,
    /// Where the points that a window could not decide can be looked at again.
    again: Option<LookAgain>,
    /// What windows leave open, where that can be decided later.
    front: Option<Front>,
    /// When windows that are not segmented yet are given up.
    deadline: Option<Instant>,
}

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

struct SegmentedWindow {
    index: u64,
    spans: Vec<Arc<Span>>,
    /// Spans before this one are in no later window.
    leaving: u64,
    /// Earlier points that were brought back, and whose labels come with those of the spans.
    context: Option<Context>,
    look: Job<Result<Look>>,
    is_second_look: bool,
}

impl Pipeline {
    /// Streams `spans`, whose coordinates lie on `lattice`, through windows of `size`. A segmentor that cannot label
    /// several windows at the same time gets a crew of one.
    pub fn new(
        mut spans: Spans,
        lattice: Lattice,
        segmentor: Arc<dyn Segmentor>,
        size: WindowSize,
        crew: Crew,
    ) -> Self {
        let crew = if segmentor.is_concurrent() { crew } else { Crew::of_one() };
        let exactness = segmentor.exactness();
        let again = LookAgain::new(&segmentor, || spans.archive(), lattice);
        let sightings = sees_beyond(exactness).then(|| Sightings::new(again.is_some()));
        let front = matches!(exactness, Exactness::Proven { .. }).then(Front::default);
        let out_of_scope = match (&sightings, &front) {
            (Some(sightings), _) => sightings.out_of_scope(),
            (None, Some(_)) => OutOfScope::awaited(),
            (None, None) => OutOfScope::default(),
        };
        let slider = Slider::new(size, lattice).with_halo(exactness.halo());
        let names = segmentor.reads();
        let pipeline = Self {
            spans: Some(spans),
            slider,
            revisit: None,
            segmentor,
            crew,
            under_way: VecDeque::new(),
            weaver: Weaver::with_late_joins(out_of_scope),
            live: VecDeque::new(),
            ready: VecDeque::new(),
            untold: Vec::new(),
            failure: None,
            finished: false,
            look_up: Box::new(|_| Ok(())),
            progress: Progress::default(),
            planes: LivePlanes::default(),
            certificate: Certificate::default(),
            front,
            undecided: Undecided::default(),
            sightings,
            again,
            deadline: None,
        };
        pipeline.with_attributes(names)
    }

    /// Has `look_up` called at least once a window; its error interrupts the run, which can then go on or be stopped.
    #[must_use]
    pub fn with_look_up(mut self, look_up: impl FnMut(&Progress) -> Result<()> + Send + 'static) -> Self {
        self.look_up = Box::new(look_up);
        self
    }

    /// Names the attributes that chunks bring along, if they are others than those that the segmentor reads.
    #[must_use]
    pub fn with_attributes(mut self, names: Vec<String>) -> Self {
        self.again = self.again.map(|again| again.with_attributes(&names));
        self.slider = self.slider.with_attributes(names);
        self
    }

    /// Brings points that have gone out of scope back to new windows within reach of them, for streams that may come back to
    /// where they were.
    #[must_use]
    pub fn with_revisit(mut self, revisit: Revisit) -> Self {
        self.revisit = Some(revisit);
        self.weaver = Weaver::with_late_joins(OutOfScope::all());
        self
    }

    /// Asks the source for nothing more: the points that have come are segmented and come out, then the stream ends.
    pub fn stop(&mut self) {
        if let Some(spans) = &mut self.spans {
            spans.stop();
        }
    }

    /// Stops, and gives up the windows that are not segmented `patience` from now: those of their points that no window
    /// before them had do not come out.
    pub fn stop_within(&mut self, patience: Duration) {
        self.stop();
        self.deadline = Instant::now().checked_add(patience);
    }

    /// Whether nothing more will come out: no span and no failure.
    pub fn is_ended(&self) -> bool {
        self.finished && self.ready.is_empty() && self.failure.is_none()
    }

    /// How far the run is.
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// What the run could prove so far; after the end, whether streamed and static are sure to be the same.
    pub fn certificate(&self) -> Certificate {
        // Nothing was early if all that came was in one window.
        let is_whole = self.finished && self.progress.windows <= 1;
        let early_decisions = if is_whole { 0 } else { self.certificate.early_decisions };
        Certificate { early_decisions, ..self.certificate }
    }

    /// Whether points that a window could not decide are looked at again, wherever what they depend on is.
    pub fn looks_again(&self) -> bool {
        self.again.is_some()
    }

    /// The log of joins and closings, which turns raw and carried ids into final ones after the end.
    pub fn aliases(&mut self) -> &mut Aliases {
        self.weaver.aliases()
    }

    /// The weaver's tables, to be counted.
    pub fn weaver(&self) -> &Weaver {
        &self.weaver
    }

    /// One step of the figure; whether there is more to do.
    fn step(&mut self) -> Result<bool> {
        (self.look_up)(&self.progress)?;
        if self.deadline.is_some_and(|deadline| Instant::now() >= deadline) {
            let failure = self.failure.take();
            self.give_up(failure);
        }
        if self.under_way.len() < self.crew.threads() && self.take_in_span() {
            return Ok(true);
        }
        if !self.under_way.is_empty() {
            self.weave_window()?;
            return Ok(true);
        }
        self.finish_front()?;
        let left = self.weaver.finish();
        self.revisit = None;
        self.hand_out(left);
        self.finished = true;
        Ok(false)
    }

    /// Takes the next span in and has a window segmented when it is complete; whether there was a span.
    fn take_in_span(&mut self) -> bool {
        match self.next_window() {
            Ok(Some((window, context))) => {
                self.segment_window(window, context);
                return true;
            }
            Ok(None) => (),
            Err(error) => {
                self.give_up(Some(error));
                return true;
            }
        }
        let next = self.spans.as_mut().map(Iterator::next);
        if let Some(spans) = &self.spans {
            let Waits { points, most } = spans.waits();
            (self.certificate.waited_points, self.certificate.most_waiting) = (points, most);
        }
        match next {
            Some(Some(Ok(span))) => self.slider.push(span),
            Some(ended) => {
                // After a failure, all that had come is still segmented; the failure is told at the very end.
                self.failure = ended.and_then(Result::err).or(self.failure.take());
                self.spans = None;
                self.slider.end();
            }
            None => return false,
        }
        true
    }

    fn next_window(&mut self) -> Result<Option<(Window, Option<Context>)>> {
        match &mut self.revisit {
            Some(revisit) => revisit.next_window(&mut self.slider),
            None => Ok(self.slider.next_window().map(|window| (window, None))),
        }
    }

    fn segment_window(&mut self, window: Window, context: Option<Context>) {
        let segmentor = Arc::clone(&self.segmentor);
        let (index, spans) = (window.index(), window.own_spans().to_vec());
        let is_last =
            spans.last().is_some_and(|span| span.extent.is_some_and(|Extent { high, .. }| high == f64::INFINITY));
        let leaving = self.slider.next_first_span().filter(|_| !is_last).unwrap_or(u64::MAX);
        let before = context.as_ref().map_or(0, Context::len);
        let look = self.crew.start(move || look(&*segmentor, &window, before));
        self.under_way.push_back(SegmentedWindow { index, spans, leaving, context, look, is_second_look: false });
    }

    fn weave_window(&mut self) -> Result<()> {
        let Some(first) = self.under_way.front_mut() else { return Ok(()) };
        let look = first.look.wait_until(self.deadline, &mut || (self.look_up)(&self.progress))?;
        let Some(look) = look else { return Ok(()) };
        let Some(window) = self.under_way.pop_front() else { return Ok(()) };
        let look = match look {
            Ok(Ok(look)) => look,
            failed => {
                self.fail(window.index, failed.map(Result::err));
                return Ok(());
            }
        };
        self.undecided.take_in(&window.spans, look.segmented.undecided.as_deref().unwrap_or_default());
        let points = self.undecided.before(window.leaving, &window.spans);
        match &self.again {
            Some(again) if !points.is_empty() && !window.is_second_look => {
                let (again, index, spans) = (again.clone(), window.index, window.spans.clone());
                let look = self.crew.start(move || again.look(index, &spans, look, &points));
                self.under_way.push_front(SegmentedWindow { look, is_second_look: true, ..window });
                Ok(())
            }
            _ => self.weave(window, look),
        }
    }

    fn weave(&mut self, window: SegmentedWindow, look: Look) -> Result<()> {
        let SegmentedWindow { index, spans, context, .. } = window;
        let Look { segmented, sights, of_context } = look;
        let Segmented { labels, seeded, planes, mut tally, frontier, .. } = segmented;
        let begun = Instant::now();
        let returned = match self.returned(context.as_ref(), &of_context, planes.as_deref()) {
            Ok(returned) => returned,
            Err(error) => {
                self.give_up(Some(error));
                return Ok(());
            }
        };
        tally.returned_points += of_context.len() as u64;
        if self.may_come_back_to(&spans) {
            tally.early_decisions += labels.of_points().iter().filter(|label| **label >= 0).count() as u64;
        }
        let span_points: Vec<usize> = spans.iter().map(|span| span.len()).collect();
        let first_span = spans.first().map_or(0, |span| span.index);
        let first_segment_id = self.weaver.next_id();
        let evicted = {
            let agrees = planes.as_ref().map(|planes| self.planes.agreement(&*self.segmentor, planes));
            let window = LabelledWindow {
                index,
                first_span,
                span_points: &span_points,
                labels: &labels,
                seeded: seeded.as_deref(),
                agrees: agrees.as_ref().map(|agrees| agrees as &Agreement),
                returned: &returned,
            };
            self.weaver.weave(&window, &self.crew)?
        };
        let joined = match (&mut self.sightings, &frontier) {
            (Some(sightings), _) => sightings.join(&sights, first_segment_id, index, &evicted, &mut self.weaver),
            (_, Some(frontier)) => self.advance_front(index, frontier, first_segment_id, &mut tally),
            (None, None) => Ok(()),
        };
        self.planes.take_in(first_segment_id, planes.unwrap_or_default(), self.weaver.oldest_live_id());
        self.progress.weaving += begun.elapsed();
        self.untold.push(WovenWindow {
            index,
            first_span,
            spans: spans.len(),
            points: span_points.iter().sum(),
            first_segment_id,
            segments: labels.count(),
            tally,
        });
        self.certificate += tally;
        self.hand_out(evicted);
        let known = self.live.back().map_or(0, |span| span.index + 1);
        self.live.extend(spans.into_iter().filter(|span| span.index >= known));
        if let Err(error) = joined {
            self.give_up(Some(error));
        }
        self.progress.windows += 1;
        self.progress.segment_ids = self.weaver.next_id() - 1;
        self.progress.segments = self.progress.segment_ids - self.weaver.joins();
        Ok(())
    }

    /// The earlier segments that came back with the context of a window, and are to be one with its labels.
    fn returned(
        &mut self,
        context: Option<&Context>,
        labels: &[i32],
        planes: Option<&[Plane]>,
    ) -> Result<Vec<Returned>> {
        let raw_id = |span, position| self.weaver.raw_id(span, position);
        let mut returned = context.map(|context| context.returned(labels, raw_id)).unwrap_or_default();
        if let (Some(revisit), Some(planes)) = (&mut self.revisit, planes) {
            revisit.agreeing(&mut returned, &*self.segmentor, self.weaver.next_id(), planes)?;
        }
        Ok(returned)
    }

    /// Whether more of the cloud may come to where the spans are and undo what is decided now. Spans of space hold all that
    /// ever comes to their place; and where more points can only join more, and are brought together whenever they come,
    /// nothing is undone.
    fn may_come_back_to(&self, spans: &[Arc<Span>]) -> bool {
        let is_undone_by_none = self.revisit.is_some() && self.segmentor.exactness().is_monotone();
        !is_undone_by_none && spans.iter().any(|span| span.extent.is_none())
    }

    /// Joins what the window just woven decides of what it and those before it left open.
    fn advance_front(&mut self, window: u64, frontier: &Frontier, first: SegmentId, tally: &mut Tally) -> Result<()> {
        let Some(front) = &mut self.front else { return Ok(()) };
        let decided = front.decided();
        let joins = front.advance(frontier, first);
        tally.decided_edges += front.decided() - decided;
        tally.waiting_edges = front.waiting() as u64;
        self.weaver.join_late(&joins, window)?;
        self.weaver.await_segments(&front.awaited());
        Ok(())
    }

    /// Joins what still waits because the stream ended before the cloud did.
    fn finish_front(&mut self) -> Result<()> {
        let Some(front) = &mut self.front else { return Ok(()) };
        let joins = front.finish();
        self.certificate.decided_edges += std::mem::take(&mut self.certificate.undecided_edges);
        self.weaver.join_late(&joins, self.progress.windows.saturating_sub(1))
    }

    /// Ends the run because of what the segmentor said of window `index`.
    fn fail(&mut self, index: u64, answer: std::result::Result<Option<Error>, String>) {
        let panicked = |message| Error::Panicked { segmentor: self.segmentor.name().into(), window: index, message };
        let error = answer.unwrap_or_else(|message| Some(panicked(message)));
        self.give_up(error);
    }

    /// Gives up all windows that have not been woven.
    fn give_up(&mut self, failure: Option<Error>) {
        self.failure = failure;
        self.revisit = None;
        self.spans = None;
        self.under_way.clear();
        self.slider.clear();
    }

    fn hand_out(&mut self, evicted: Vec<EvictedSpan>) {
        for segmented in evicted {
            self.certificate.undecided_points += self.undecided.evict(segmented.index) as u64;
            if let Some(Err(error)) = self.revisit.as_mut().map(|revisit| revisit.evict(&segmented)) {
                self.give_up(Some(error));
            }
            if let Some(span) = self.live.pop_front() {
                self.progress.points += span.len() as u64;
                let windows = std::mem::take(&mut self.untold);
                self.ready.push_back(Outgoing { span, segmented, windows });
            }
        }
        self.progress.live_segments = self.weaver.live_segments();
    }
}

/// The planes of the segments in scope, where segments of two windows are one only if their planes agree.
#[derive(Default)]
struct LivePlanes {
    /// The segment of the first plane; those of the next ids follow.
    oldest: SegmentId,
    planes: VecDeque<Plane>,
}

impl LivePlanes {
    /// Whether a segment in scope and a label of the window whose planes are `newest` agree.
    fn agreement(&self, segmentor: &dyn Segmentor, newest: &[Plane]) -> impl Fn(SegmentId, i32) -> bool + Sync {
        move |segment_id, label| {
            let earlier = self.planes.get((segment_id - self.oldest) as usize);
            earlier.zip(newest.get(label as usize)).is_none_or(|(earlier, later)| segmentor.agree(earlier, later))
        }
    }

    /// Takes in the planes of a window's segments, whose ids start from `first`, and forgets those of segments older than
    /// `oldest_live`.
    fn take_in(&mut self, first: SegmentId, newest: Vec<Plane>, oldest_live: SegmentId) {
        if self.planes.is_empty() {
            self.oldest = first;
        }
        self.planes.extend(newest);
        let forgotten = (oldest_live - self.oldest).clamp(0, self.planes.len() as i64);
        self.planes.drain(..forgotten as usize);
        self.oldest += forgotten;
    }
}

impl Iterator for Pipeline {
    type Item = Result<Outgoing>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(span) = self.ready.pop_front() {
                return Some(Ok(span));
            }
            if self.finished {
                return self.failure.take().map(Err);
            }
            if let Err(error) = self.step() {
                return Some(Err(error));
            }
        }
    }
}
