//! Windows: the spans that are segmented together, sliding over the stream.
//!
//! Seed of the framework: windows of 3 spans that overlap by 1, so the window moves on by 2 (moving-window
//! segmentation, ISPRS Annals I-3, 2012). Number and overlap are free as long as the window moves.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::error::{Error, Result, at_least_one};
use crate::lattice::{Lattice, is_valid};
use crate::span::{Extent, Span};

/// How many spans a window has and how many of them it shares with the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowSize {
    spans: usize,
    overlap: usize,
}

impl Default for WindowSize {
    /// The paper's: 3 spans, 1 of them shared.
    fn default() -> Self {
        Self { spans: 3, overlap: 1 }
    }
}

impl WindowSize {
    /// Windows of `spans` spans, `overlap` of them shared with the next window.
    ///
    /// # Errors
    /// If there is no span, or the window would not move on.
    pub fn new(spans: usize, overlap: usize) -> Result<Self> {
        at_least_one("spans", spans)?;
        if overlap >= spans {
            return Err(Error::InvalidParameter {
                name: "overlap",
                given: format!("{overlap} of {spans} spans"),
                allowed: "fewer spans than the window has, or the window would never move on",
            });
        }
        Ok(Self { spans, overlap })
    }

    /// Spans per window.
    pub fn spans(&self) -> usize {
        self.spans
    }

    /// Spans that two consecutive windows share.
    pub fn overlap(&self) -> usize {
        self.overlap
    }

    /// By how many spans the window moves on.
    pub fn advance(&self) -> usize {
        self.spans - self.overlap
    }
}

/// What a segmentor sees: the valid points of some consecutive spans.
#[derive(Debug)]
pub struct Window {
    index: u64,
    spans: Vec<Arc<Span>>,
    lattice: Lattice,
    points: Vec<[f64; 3]>,
    /// Positions of the valid points among all, where some are not.
    valid: Option<Vec<u32>>,
}

impl Window {
    /// Gathers the points of `spans`.
    pub fn new(index: u64, spans: Vec<Arc<Span>>, lattice: Lattice) -> Self {
        let mut points = Vec::with_capacity(spans.iter().map(|span| span.len()).sum());
        for span in &spans {
            points.extend_from_slice(&span.points);
        }
        let mut valid = None;
        if !points.iter().all(is_valid) {
            let kept: Vec<u32> = (0..points.len() as u32).filter(|&i| is_valid(&points[i as usize])).collect();
            points.retain(is_valid);
            valid = Some(kept);
        }
        Self { index, spans, lattice, points, valid }
    }

    /// Number of the window, from 0.
    pub fn index(&self) -> u64 {
        self.index
    }

    /// The spans, in stream order.
    pub fn spans(&self) -> &[Arc<Span>] {
        &self.spans
    }

    /// Lattice coordinates of the valid points, in stream order.
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// The lattice of the coordinates.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Positions of the valid points among all points of the spans; none while all are valid.
    pub fn valid(&self) -> Option<&[u32]> {
        self.valid.as_deref()
    }

    /// The part of the map all of whose points this window holds, if its spans are ones of space.
    pub fn extent(&self) -> Option<Extent> {
        let (first, last) = (self.spans.first()?.extent?, self.spans.last()?.extent?);
        Some(Extent { high: last.high, ..first })
    }

    /// Whether every point of the cloud within `radius` (in units of the coordinates) of `point` on the map is in this
    /// window. Where spans are cut in stream order nothing is known, and it counts as true.
    pub fn holds(&self, point: &[f64; 3], radius: f64) -> bool {
        self.extent().is_none_or(|extent| extent.holds(point, radius, &self.lattice))
    }

    /// How many points the spans have, valid or not.
    pub fn len(&self) -> usize {
        self.spans.iter().map(|span| span.len()).sum()
    }

    /// Whether the spans have no point.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The point ids of the valid points.
    pub fn point_ids(&self) -> Vec<i64> {
        let all: Vec<i64> =
            self.spans.iter().flat_map(|span| (0..span.len()).map(|position| span.point_id(position))).collect();
        match &self.valid {
            Some(valid) => valid.iter().map(|&i| all[i as usize]).collect(),
            None => all,
        }
    }
}

/// Slides a window over spans as they come.
#[derive(Debug)]
pub struct Slider {
    size: WindowSize,
    lattice: Lattice,
    held: VecDeque<Arc<Span>>,
    /// How many of the held spans have been in no window yet.
    fresh: usize,
    index: u64,
}

impl Slider {
    /// A window of `size` before the first span.
    pub fn new(size: WindowSize, lattice: Lattice) -> Self {
        Self { size, lattice, held: VecDeque::new(), fresh: 0, index: 0 }
    }

    /// Takes the next span, and returns a window when it is complete.
    pub fn push(&mut self, span: Span) -> Option<Window> {
        self.held.push_back(Arc::new(span));
        self.fresh += 1;
        (self.held.len() == self.size.spans).then(|| self.advance())
    }

    /// The last window, with fewer spans, if some have been in no window yet.
    pub fn finish(&mut self) -> Option<Window> {
        (self.fresh > 0).then(|| self.advance())
    }

    /// Forgets the spans of a window that will never come.
    pub fn clear(&mut self) {
        self.held.clear();
        self.fresh = 0;
    }

    fn advance(&mut self) -> Window {
        let window = Window::new(self.index, self.held.iter().cloned().collect(), self.lattice);
        self.held.drain(..self.size.advance().min(self.held.len()));
        self.fresh = 0;
        self.index += 1;
        window
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::PointIds;

    fn windows_over(spans: u64, size: WindowSize) -> Vec<Vec<u64>> {
        let mut slider = Slider::new(size, Lattice::REAL);
        let span = |index| Span { index, point_ids: PointIds::From(0), points: vec![], extent: None };
        let mut windows: Vec<Window> = (0..spans).filter_map(|i| slider.push(span(i))).collect();
        windows.extend(slider.finish());
        assert!(slider.finish().is_none());
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

    #[test]
    fn a_window_has_to_move() {
        assert!(WindowSize::new(3, 3).unwrap_err().to_string().contains("overlap is 3 of 3 spans"));
        assert!(WindowSize::new(0, 0).is_err());
    }

    #[test]
    fn invalid_points_are_kept_from_the_segmentor() {
        let points = vec![[0.0; 3], [f64::NAN; 3], [1.0; 3]];
        let span = Span { index: 0, point_ids: PointIds::Listed(vec![4, 7, 9]), points, extent: None };
        let window = Window::new(0, vec![Arc::new(span)], Lattice::REAL);
        assert_eq!(window.points().len(), 2);
        assert_eq!(window.valid(), Some(&[0, 2][..]));
        assert_eq!(window.point_ids(), [4, 9]);
        assert_eq!(window.len(), 3);
    }
}
