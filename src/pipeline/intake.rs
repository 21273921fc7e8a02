//! The left half of the figure: source → spans → windows, behind what is brought back for them.

use crate::error::{Error, Result};
use crate::revisit::{Context, Revisit};
use crate::span::{Span, Spans, Waits};
use crate::weaver::EvictedSpan;
use crate::window::{Slider, Window};

/// Takes spans in and makes windows of them.
pub(super) struct Intake {
    /// None when the source has ended.
    spans: Option<Spans>,
    slider: Slider,
    /// Where points that have gone out of scope come back.
    revisit: Option<Revisit>,
    waits: Waits,
}

/// What one step of taking in has come to.
pub(super) enum TakenIn {
    /// A window is complete.
    Window(Box<Window>, Option<Context>),
    /// A span more is there.
    Span,
    /// The source has ended, perhaps because it failed; the spans that have come still make windows.
    End(Option<Error>),
    /// There is nothing left.
    Nothing,
}

impl Intake {
    pub fn new(spans: Spans, slider: Slider) -> Self {
        Self { spans: Some(spans), slider, revisit: None, waits: Waits::default() }
    }

    pub fn with_attributes(self, names: Vec<String>) -> Self {
        Self { slider: self.slider.with_attributes(names), ..self }
    }

    pub fn with_revisit(self, revisit: Revisit) -> Self {
        Self { revisit: Some(revisit), ..self }
    }

    /// Takes in what is next: a window if one is complete, else a span.
    pub fn step(&mut self) -> Result<TakenIn> {
        if let Some((window, context)) = self.next_window()? {
            return Ok(TakenIn::Window(Box::new(window), context));
        }
        let Some(spans) = &mut self.spans else { return Ok(TakenIn::Nothing) };
        let next = spans.next();
        self.waits = spans.waits();
        Ok(match next {
            Some(Ok(span)) => self.push(span),
            ended => {
                self.spans = None;
                self.slider.end();
                TakenIn::End(ended.and_then(Result::err))
            }
        })
    }

    fn push(&mut self, span: Span) -> TakenIn {
        self.slider.push(span);
        TakenIn::Span
    }

    fn next_window(&mut self) -> Result<Option<(Window, Option<Context>)>> {
        match &mut self.revisit {
            Some(revisit) => revisit.next_window(&mut self.slider),
            None => Ok(self.slider.next_window().map(|window| (window, None))),
        }
    }

    /// How many points of the stream the next window loads, if its spans have come.
    pub fn next_points(&self) -> Option<usize> {
        self.slider.next_points()
    }

    /// Spans before this one are in no window but those that have been made.
    pub fn leaving(&self) -> Option<u64> {
        self.slider.next_first_span()
    }

    /// Which points waited on disk before their span was complete.
    pub fn waits(&self) -> Waits {
        self.waits
    }

    pub fn revisit(&mut self) -> Option<&mut Revisit> {
        self.revisit.as_mut()
    }

    /// Keeps a span that goes out of scope, if spans may come back to where it was.
    pub fn evict(&mut self, evicted: &EvictedSpan) -> Result<()> {
        self.revisit.as_mut().map_or(Ok(()), |revisit| revisit.evict(evicted))
    }

    /// Asks the source for nothing more; what it has handed over already still comes.
    pub fn stop(&mut self) {
        if let Some(spans) = &mut self.spans {
            spans.stop();
        }
    }

    /// Lets go of everything; no window will come.
    pub fn close(&mut self) {
        self.spans = None;
        self.revisit = None;
        self.slider.clear();
    }
}
