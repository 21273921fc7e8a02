//! Surveys: whatever is to be known of a cloud that needs no weaving, window by window in bounded memory.
//!
//! Each window has one span of its own and a halo around it. So every point is a window's own exactly once, and what is
//! found out about the own points is all there is to be told.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::crew::{Crew, Job};
use crate::error::{Error, Result};
use crate::lattice::Lattice;
use crate::span::{PointIds, Spans};
use crate::window::{Halo, Slider, Window, WindowSize};

/// What is done with a window.
pub type Work<R> = Arc<dyn Fn(&Window) -> Result<R> + Send + Sync>;

/// Called now and then; its error interrupts the survey, which can then go on.
pub type LookUp = Box<dyn FnMut() -> Result<()> + Send>;

/// An iterator over what `work` makes of each window, in order.
pub struct Survey<R> {
    spans: Option<Spans>,
    slider: Slider,
    work: Work<R>,
    crew: Crew,
    under_way: VecDeque<Job<Result<R>>>,
    failure: Option<Error>,
    look_up: LookUp,
}

impl<R: Send + 'static> Survey<R> {
    /// Surveys `spans`, whose coordinates lie on `lattice` and whose attributes have the `names`.
    ///
    /// # Errors
    /// Never, but for defects.
    pub fn new(
        spans: Spans,
        lattice: Lattice,
        names: Vec<String>,
        halo: Halo,
        crew: Crew,
        work: Work<R>,
    ) -> Result<Self> {
        let slider = Slider::new(WindowSize::new(1, 0)?, lattice).with_halo(halo).with_attributes(names);
        let look_up: LookUp = Box::new(|| Ok(()));
        Ok(Self { spans: Some(spans), slider, work, crew, under_way: VecDeque::new(), failure: None, look_up })
    }

    /// Has `look_up` called at least once a window.
    #[must_use]
    pub fn with_look_up(mut self, look_up: impl FnMut() -> Result<()> + Send + 'static) -> Self {
        self.look_up = Box::new(look_up);
        self
    }

    /// Takes the next span in and starts on a window when it is complete; whether there was a span.
    fn take_in_span(&mut self) -> bool {
        if let Some(window) = self.slider.next_window() {
            let work = Arc::clone(&self.work);
            self.under_way.push_back(self.crew.start(move || work(&window)));
            return true;
        }
        match self.spans.as_mut().map(Iterator::next) {
            Some(Some(Ok(span))) => self.slider.push(span),
            Some(ended) => {
                // What had come before a failure is still worked on.
                self.failure = ended.and_then(Result::err);
                self.spans = None;
                self.slider.end();
            }
            None => return false,
        }
        true
    }

    fn step(&mut self) -> Result<Option<R>> {
        loop {
            (self.look_up)()?;
            if self.under_way.len() < self.crew.threads() && self.take_in_span() {
                continue;
            }
            let Some(first) = self.under_way.front_mut() else { return self.failure.take().map_or(Ok(None), Err) };
            let answer = first.wait(&mut self.look_up)?;
            self.under_way.pop_front();
            let answer = answer.unwrap_or_else(|message| Err(Error::Foreign(message.into())));
            if answer.is_err() {
                self.spans = None;
                self.slider.clear();
                self.under_way.clear();
            }
            return answer.map(Some);
        }
    }
}

impl<R: Send + 'static> Iterator for Survey<R> {
    type Item = Result<R>;

    fn next(&mut self) -> Option<Self::Item> {
        self.step().transpose()
    }
}

/// The ids of a window's own points.
pub struct OwnIds<'a>(&'a Window);

impl<'a> OwnIds<'a> {
    /// Those of `window`.
    pub fn of(window: &'a Window) -> Self {
        Self(window)
    }

    /// Whether the point is one of the window's own.
    pub fn contains(&self, point_id: i64) -> bool {
        self.0.own_spans().iter().any(|span| match &span.point_ids {
            PointIds::From(first) => (*first..first + span.len() as i64).contains(&point_id),
            PointIds::Listed(ids) => ids.binary_search(&point_id).is_ok(),
        })
    }
}
