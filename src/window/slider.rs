//! Slides a window over spans as they come: which spans are in the next window, and which of them are its halo.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use super::{Halo, Window, WindowSize};
use crate::lattice::Lattice;
use crate::span::{Extent, Span};

/// The spans of a window, before their points are gathered.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    /// Number of the window.
    pub index: u64,
    /// The spans, halo included.
    pub spans: Vec<Arc<Span>>,
    /// Which of them are the window's own.
    pub own: Range<usize>,
}

impl Frame {
    /// The same behind points that are only looked at.
    pub fn behind(mut self, context: Arc<Span>) -> Self {
        self.spans.insert(0, context);
        Self { own: self.own.start + 1..self.own.end + 1, ..self }
    }
}

/// Slides a window over spans as they come.
#[derive(Debug)]
pub struct Slider {
    size: WindowSize,
    halo: Halo,
    lattice: Lattice,
    names: Vec<String>,
    held: VecDeque<Arc<Span>>,
    /// How many of the held spans come before the next window's own, as its halo.
    before: usize,
    /// How many of the next window's own spans were in the last one.
    shared: usize,
    index: u64,
    ended: bool,
}

impl Slider {
    /// A window of `size` before the first span.
    pub fn new(size: WindowSize, lattice: Lattice) -> Self {
        Self {
            size,
            halo: Halo::None,
            lattice,
            names: Vec::new(),
            held: VecDeque::new(),
            before: 0,
            shared: 0,
            index: 0,
            ended: false,
        }
    }

    /// Loads a halo around each window.
    #[must_use]
    pub fn with_halo(mut self, halo: Halo) -> Self {
        // Lengths are compared with borders of spans, which rounding may have moved.
        let in_steps = |length: f64| length * (1.0 + 1e-6) / self.lattice.horizontal_unit();
        self.halo = match halo {
            Halo::None => Halo::None,
            Halo::Length(length) => Halo::Length(in_steps(length)),
            Halo::SpanBeyond(length) => Halo::SpanBeyond(in_steps(length)),
        };
        self
    }

    /// Names the attributes of the spans.
    #[must_use]
    pub fn with_attributes(mut self, names: Vec<String>) -> Self {
        self.names = names;
        self
    }

    /// Takes the next span.
    pub fn push(&mut self, span: Span) {
        self.held.push_back(Arc::new(span));
    }

    /// Tells that no span will come.
    pub fn end(&mut self) {
        self.ended = true;
    }

    /// The next window, if the spans that it needs have come.
    pub fn next_window(&mut self) -> Option<Window> {
        self.next_frame().map(|frame| self.gather(frame))
    }

    /// How many points the next window loads, if the spans that it needs have come.
    pub fn next_points(&self) -> Option<usize> {
        self.next_end().map(|end| self.loads(end))
    }

    /// The spans of the next window.
    pub(crate) fn next_frame(&mut self) -> Option<Frame> {
        self.next_end().map(|end| self.advance(end))
    }

    /// Where the own spans of the next window end, if those that it needs have come.
    fn next_end(&self) -> Option<usize> {
        let there = self.held.len() - self.before;
        let end = self.before + self.size.spans().min(there);
        let is_ready = there >= self.size.spans() && self.has_halo(end);
        // When the source has ended, the last window may have fewer spans.
        if !(is_ready || self.ended && there > self.shared) {
            return None;
        }
        self.size.room().map_or(Some(end), |room| self.fill(end, room))
    }

    /// Where the own spans end if behind `end` as many more are taken as there is room for; none while that depends on
    /// what is to come.
    fn fill(&self, mut end: usize, room: usize) -> Option<usize> {
        while end < self.held.len() {
            if self.loads(end + 1) > room {
                return Some(end);
            }
            if !self.has_halo(end + 1) && !self.ended {
                return None;
            }
            end += 1;
        }
        self.ended.then_some(end)
    }

    /// How many points a window whose own spans end before `end` loads, as far as they have come.
    fn loads(&self, end: usize) -> usize {
        self.held.range(..end + self.after(end)).map(|span| span.len()).sum()
    }

    /// The first span of the next window, if it has come already.
    pub fn next_first_span(&self) -> Option<u64> {
        self.held.get(self.before).map(|span| span.index)
    }

    /// Forgets the spans of windows that will never come.
    pub fn clear(&mut self) {
        self.held.clear();
        (self.before, self.shared) = (0, 0);
    }

    /// Whether what lies behind the own spans up to `end` has been loaded far enough.
    fn has_halo(&self, end: usize) -> bool {
        match self.halo {
            Halo::None => true,
            Halo::SpanBeyond(length) => {
                self.held.len() > end + self.within_after(end, length) || self.ends_with_cloud()
            }
            Halo::Length(length) => match (self.held[end - 1].extent, self.held.back().and_then(|span| span.extent)) {
                (Some(own), Some(last)) => last.high >= own.high + length,
                _ => true,
            },
        }
    }

    fn ends_with_cloud(&self) -> bool {
        self.held.back().is_some_and(|span| span.extent.is_none_or(|extent| extent.high == f64::INFINITY))
    }

    /// How many spans behind `end` belong to the halo.
    fn after(&self, end: usize) -> usize {
        match self.halo {
            Halo::None => 0,
            Halo::Length(length) => self.within_after(end, length),
            Halo::SpanBeyond(length) => {
                let near = self.within_after(end, length);
                near + count_in_space(self.held.range(end + near..).take(1))
            }
        }
    }

    /// How many spans behind `end` begin within the length.
    fn within_after(&self, end: usize, length: f64) -> usize {
        let own = self.held[end - 1].extent;
        let is_near = |e: &Extent| own.is_some_and(|own| e.low < own.high + length);
        self.held.range(end..).take_while(|span| span.extent.as_ref().is_some_and(is_near)).count()
    }

    /// A window over the same spans once more.
    pub(crate) fn again(&mut self, frame: &Frame) -> Frame {
        let index = self.index;
        self.index += 1;
        Frame { index, ..frame.clone() }
    }

    /// The window of some spans.
    pub(crate) fn gather(&self, Frame { index, spans, own }: Frame) -> Window {
        Window::with_halo(index, spans, own, self.lattice, &self.names)
    }

    fn advance(&mut self, end: usize) -> Frame {
        let loaded = end + self.after(end);
        let frame =
            Frame { index: self.index, spans: self.held.range(..loaded).cloned().collect(), own: self.before..end };
        let first = end - self.size.overlap().min(end - self.before);
        self.shared = end - first;
        let kept = first - self.halo_before(first);
        self.held.drain(..kept);
        self.before = first - kept;
        self.index += 1;
        frame
    }

    /// How many spans before `first` belong to the halo.
    fn halo_before(&self, first: usize) -> usize {
        match self.halo {
            Halo::None => 0,
            Halo::Length(length) => self.within_before(first, length),
            Halo::SpanBeyond(length) => {
                let near = self.within_before(first, length);
                near + count_in_space(self.held.range(..first - near).rev().take(1))
            }
        }
    }

    /// How many spans before `first` end within the length.
    fn within_before(&self, first: usize, length: f64) -> usize {
        let own = self.held.get(first).or(self.held.back()).and_then(|span| span.extent);
        let own_low = own.map(|own| if self.held.len() > first { own.low } else { own.high });
        let is_near = |e: &Extent| own_low.is_some_and(|low| e.high > low - length);
        self.held.range(..first).rev().take_while(|span| span.extent.as_ref().is_some_and(is_near)).count()
    }
}

fn count_in_space<'a>(spans: impl Iterator<Item = &'a Arc<Span>>) -> usize {
    spans.filter(|span| span.extent.is_some()).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::PointIds;

    fn windows_over(spans: u64, size: WindowSize) -> Vec<Vec<u64>> {
        let mut slider = Slider::new(size, Lattice::REAL);
        let span =
            |index| Span { index, point_ids: PointIds::From(0), points: vec![], attributes: vec![], extent: None };
        let mut windows: Vec<Window> = Vec::new();
        for index in 0..spans {
            slider.push(span(index));
            windows.extend(slider.next_window());
            assert!(slider.next_window().is_none());
        }
        slider.end();
        windows.extend(slider.next_window());
        assert!(slider.next_window().is_none());
        assert!(windows.iter().enumerate().all(|(i, w)| w.index() == i as u64));
        windows.iter().map(|w| w.spans().iter().map(|s| s.index).collect()).collect()
    }

    #[test]
    fn the_papers_window_moves_on_by_two_of_three_spans() {
        let size = WindowSize::default();
        assert_eq!(windows_over(5, size), [vec![0, 1, 2], vec![2, 3, 4]]);
        assert_eq!(windows_over(6, size), [vec![0, 1, 2], vec![2, 3, 4], vec![4, 5]]);
        assert_eq!(windows_over(2, size), [vec![0, 1]]);
        assert!(windows_over(0, size).is_empty());
    }

    #[test]
    fn neighbouring_spans_share_a_window_wherever_there_is_an_overlap() {
        for spans in 1..6 {
            for overlap in 0..spans {
                let size = WindowSize::new(spans, overlap).unwrap();
                for count in 0..20 {
                    let windows = windows_over(count, size);
                    for first in 0..count {
                        for second in first..count.min(first + overlap as u64 + 1) {
                            assert!(windows.iter().any(|w| w.contains(&first) && w.contains(&second)));
                        }
                    }
                }
            }
        }
    }
}
