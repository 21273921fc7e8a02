//! The framework's figure as code: spans → windows → SEGMENTOR → WEAVER → spans with segment ids.
//!
//! Source: moving-window segmentation (ISPRS Annals I-3, 2012, figure 1). [`Pipeline`] is an iterator: it asks the source
//! for a span only when it needs one. With one thread a span's labels come out as soon as the windows that could still
//! change its scope have been woven; each further thread reads one window ahead. What is to the left of the segmentor is
//! the [intake], what is to the right of it is [weaving].

mod allowance;
mod intake;
mod late_joins;
mod outgoing;
mod planes;
mod stopper;
mod weaving;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub use allowance::Allowance;
pub use outgoing::{Outgoing, Progress, WovenWindow};
pub use stopper::Stopper;

use crate::certificate::Certificate;
use crate::crew::{Crew, Job};
use crate::error::{Error, Result};
use crate::lattice::Lattice;
use crate::look::{Look, LookAgain, look};
use crate::revisit::{Context, Revisit};
use crate::segmentor::Segmentor;
use crate::span::{Extent, Span, Spans};
use crate::undecided::Undecided;
use crate::weaver::{Aliases, EvictedSpan, Weaver};
use crate::window::{Halo, Slider, Window, WindowSize};
use intake::{Intake, TakenIn};
use weaving::{Weaving, Woven};

/// Called now and then with the progress so far; its error interrupts the run.
pub type LookUp = Box<dyn FnMut(&Progress) -> Result<()> + Send>;

/// Streams spans through a segmentor and the weaver.
pub struct Pipeline {
    intake: Intake,
    segmentor: Arc<dyn Segmentor>,
    crew: Crew,
    /// How much may be under way; none = as many windows as there are threads, however large.
    allowance: Option<Allowance>,
    under_way: VecDeque<SegmentedWindow>,
    /// Where the points that a window could not decide can be looked at again.
    again: Option<LookAgain>,
    undecided: Undecided,
    weaving: Weaving,
    /// Spans of woven windows, in scope.
    live: VecDeque<Arc<Span>>,
    ready: VecDeque<Outgoing>,
    /// Windows that no span has told yet.
    untold: Vec<WovenWindow>,
    failure: Option<Error>,
    finished: bool,
    /// Whether not all that the source had may have been segmented.
    is_cut_short: bool,
    stopper: Stopper,
    look_up: LookUp,
    progress: Progress,
    certificate: Certificate,
}

/// A window that is being segmented.
struct SegmentedWindow {
    index: u64,
    /// How many points it has loaded.
    points: u64,
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
        let again = LookAgain::new(&segmentor, || spans.archive(), lattice);
        let halo = segmentor.halo();
        // The halo of one span is still in scope.
        let sees_far = again.is_some() || matches!(halo, Halo::SpanBeyond(length) if length > 0.0);
        let slider = Slider::new(size, lattice).with_halo(halo);
        let names = segmentor.reads();
        let pipeline = Self {
            intake: Intake::new(spans, slider),
            weaving: Weaving::new(Arc::clone(&segmentor), sees_far),
            segmentor,
            crew,
            allowance: None,
            under_way: VecDeque::new(),
            again,
            undecided: Undecided::default(),
            live: VecDeque::new(),
            ready: VecDeque::new(),
            untold: Vec::new(),
            failure: None,
            finished: false,
            is_cut_short: false,
            stopper: Stopper::default(),
            look_up: Box::new(|_| Ok(())),
            progress: Progress::default(),
            certificate: Certificate::default(),
        };
        pipeline.with_attributes(names)
    }

    /// Has `look_up` called at least once a window; its error interrupts the run, which can then go on or be stopped.
    #[must_use]
    pub fn with_look_up(mut self, look_up: impl FnMut(&Progress) -> Result<()> + Send + 'static) -> Self {
        self.look_up = Box::new(look_up);
        self
    }

    /// Lets other threads stop the run while it is at work.
    #[must_use]
    pub fn with_stopper(mut self, stopper: Stopper) -> Self {
        self.stopper = stopper;
        self
    }

    /// Names the attributes that chunks bring along, if they are others than those that the segmentor reads.
    #[must_use]
    pub fn with_attributes(mut self, names: Vec<String>) -> Self {
        self.again = self.again.map(|again| again.with_attributes(&names));
        self.intake = self.intake.with_attributes(names);
        self
    }

    /// Takes a window only if that, with all that are under way, keeps to `allowance`.
    #[must_use]
    pub fn with_allowance(self, allowance: Allowance) -> Self {
        Self { allowance: Some(allowance), ..self }
    }

    /// Brings points that have gone out of scope back to new windows within reach of them, for streams that may come back to
    /// where they were.
    #[must_use]
    pub fn with_revisit(mut self, revisit: Revisit) -> Self {
        self.intake = self.intake.with_revisit(revisit);
        self.weaving = self.weaving.with_revisit();
        self
    }

    /// Asks the source for nothing more: the points that have come are segmented and come out, then the stream ends.
    pub fn stop(&mut self) {
        self.stopper.stop(None);
        self.heed_stopper();
    }

    /// Stops, and gives up the windows that are not segmented `patience` from now: those of their points that no window
    /// before them had do not come out.
    pub fn stop_within(&mut self, patience: Duration) {
        self.stopper.stop(Some(patience));
        self.heed_stopper();
    }

    fn heed_stopper(&mut self) {
        if self.stopper.is_asked() {
            self.is_cut_short |= !self.finished;
            self.intake.stop();
        }
    }

    /// Whether nothing more will come out: no span and no failure.
    pub fn is_ended(&self) -> bool {
        self.finished && self.ready.is_empty() && self.failure.is_none()
    }

    /// Whether the run has ended, and all that the source had was segmented: it was not stopped, and nothing failed.
    pub fn is_whole(&self) -> bool {
        self.finished && !self.is_cut_short
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
        let waits = self.intake.waits();
        Certificate { early_decisions, waited_points: waits.points, most_waiting: waits.most, ..self.certificate }
    }

    /// Whether points that a window could not decide are looked at again, wherever what they depend on is.
    pub fn looks_again(&self) -> bool {
        self.again.is_some()
    }

    /// The log of joins and closings, which turns raw and carried ids into final ones after the end.
    pub fn aliases(&mut self) -> &mut Aliases {
        self.weaving.weaver_mut().aliases()
    }

    /// The weaver's tables, to be counted.
    pub fn weaver(&self) -> &Weaver {
        self.weaving.weaver()
    }

    /// One step of the figure; an error asks for a pause, not for the end.
    fn step(&mut self) -> Result<()> {
        (self.look_up)(&self.progress)?;
        self.heed_stopper();
        if self.stopper.deadline().is_some_and(|deadline| Instant::now() >= deadline) {
            self.give_up(None);
        }
        if self.has_room() && self.take_in() {
            return Ok(());
        }
        if !self.under_way.is_empty() {
            return self.weave_window();
        }
        self.finish();
        Ok(())
    }

    /// Whether what is under way leaves a thread, and room for the window that would be next.
    fn has_room(&self) -> bool {
        let in_flight = self.under_way.iter().map(|window| window.points).sum();
        let is_allowed = |points| self.allowance.is_none_or(|allowance| allowance.has_room_for(points, in_flight));
        self.under_way.len() < self.crew.threads()
            && self.intake.next_points().is_none_or(|points| is_allowed(points as u64))
    }

    /// Takes the next span in, or has a window segmented that is complete; whether there was anything.
    fn take_in(&mut self) -> bool {
        match self.intake.step() {
            Ok(TakenIn::Window(window, context)) => self.segment_window(*window, context),
            Ok(TakenIn::Span) => (),
            // All that had come is still segmented; the failure is told at the very end.
            Ok(TakenIn::End(failure)) => self.fail(failure),
            Ok(TakenIn::Nothing) => return false,
            Err(error) => self.give_up(Some(error)),
        }
        true
    }

    fn segment_window(&mut self, window: Window, context: Option<Context>) {
        let segmentor = Arc::clone(&self.segmentor);
        let (index, points, spans) = (window.index(), window.len() as u64, window.own_spans().to_vec());
        let is_last =
            spans.last().is_some_and(|span| span.extent.is_some_and(|Extent { high, .. }| high == f64::INFINITY));
        let leaving = self.intake.leaving().filter(|_| !is_last).unwrap_or(u64::MAX);
        let before = context.as_ref().map_or(0, Context::len);
        let look = self.crew.start(move || look(&*segmentor, &window, before));
        self.under_way.push_back(SegmentedWindow {
            index,
            points,
            spans,
            leaving,
            context,
            look,
            is_second_look: false,
        });
    }

    /// Waits for the oldest window under way and weaves it, unless some of its points have to be looked at again first.
    fn weave_window(&mut self) -> Result<()> {
        let Some(first) = self.under_way.front_mut() else { return Ok(()) };
        let look = first.look.wait_until(&|| self.stopper.deadline(), &mut || (self.look_up)(&self.progress))?;
        let Some(look) = look else { return Ok(()) };
        let Some(window) = self.under_way.pop_front() else { return Ok(()) };
        match look {
            Ok(Ok(look)) => self.look_again_or_weave(window, look),
            Ok(Err(error)) => self.give_up(Some(error)),
            Err(message) => {
                let segmentor = self.segmentor.name().into();
                self.give_up(Some(Error::Panicked { segmentor, window: window.index, message }));
            }
        }
        Ok(())
    }

    fn look_again_or_weave(&mut self, window: SegmentedWindow, look: Look) {
        self.undecided.take_in(&window.spans, look.segmented.undecided.as_deref().unwrap_or_default());
        let points = self.undecided.before(window.leaving, &window.spans);
        match &self.again {
            Some(again) if !points.is_empty() && !window.is_second_look => {
                let (again, index, spans) = (again.clone(), window.index, window.spans.clone());
                let look = self.crew.start(move || again.look(index, &spans, look, &points));
                self.under_way.push_front(SegmentedWindow { look, is_second_look: true, ..window });
            }
            _ => self.weave(window, look),
        }
    }

    fn weave(&mut self, window: SegmentedWindow, look: Look) {
        let SegmentedWindow { index, spans, context, .. } = window;
        let revisit = self.intake.revisit();
        let Woven { window, evicted, failure } =
            self.weaving.weave(index, &spans, context.as_ref(), look, revisit, &self.crew);
        self.weaving.take_in(&window, &mut self.certificate);
        self.untold.push(window);
        self.hand_out(evicted);
        let known = self.live.back().map_or(0, |span| span.index + 1);
        self.live.extend(spans.into_iter().filter(|span| span.index >= known));
        if failure.is_some() {
            self.give_up(failure);
        }
        let weaver = self.weaving.weaver();
        self.progress.windows += 1;
        self.progress.weaving = self.weaving.time();
        self.progress.segment_ids = weaver.next_id() - 1;
        self.progress.segments = self.progress.segment_ids - weaver.joins();
    }

    fn finish(&mut self) {
        let last = self.progress.windows.saturating_sub(1);
        let (left, failure) = self.weaving.finish(last, &mut self.certificate);
        self.fail(failure);
        self.intake.close();
        self.hand_out(left);
        self.finished = true;
    }

    /// The first failure is the one to be told, when all has come out that can.
    fn fail(&mut self, failure: Option<Error>) {
        self.is_cut_short |= failure.is_some();
        self.failure = self.failure.take().or(failure);
    }

    /// Gives up all windows that have not been woven.
    fn give_up(&mut self, failure: Option<Error>) {
        self.is_cut_short = true;
        self.fail(failure);
        self.intake.close();
        self.under_way.clear();
    }

    fn hand_out(&mut self, evicted: Vec<EvictedSpan>) {
        for segmented in evicted {
            self.certificate.undecided_points += self.undecided.evict(segmented.index) as u64;
            if let Err(error) = self.intake.evict(&segmented) {
                self.give_up(Some(error));
            }
            if let Some(span) = self.live.pop_front() {
                self.progress.points += span.len() as u64;
                let windows = std::mem::take(&mut self.untold);
                self.ready.push_back(Outgoing { span, segmented, windows });
            }
        }
        self.progress.live_segments = self.weaving.weaver().live_segments();
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
