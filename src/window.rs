//! Windows: the spans that are segmented together, sliding over the stream.
//!
//! Seed of the framework: windows of 3 spans that overlap by 1, so the window moves on by 2 (moving-window
//! segmentation, ISPRS Annals I-3, 2012). Number and overlap are free as long as the window moves.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use rustc_hash::{FxHashMap, FxHashSet};

use crate::attribute::Columns;
use crate::error::{Error, Result, at_least_one};
use crate::lattice::{Lattice, is_valid};
use crate::neighborhood::Neighborhoods;
use crate::span::{Extent, Span};

/// How many spans a window has and how many of them it shares with the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowSize {
    spans: usize,
    overlap: usize,
    /// So many points, halo included, a window of more spans than that may load; none = it has no more.
    room: Option<usize>,
}

impl Default for WindowSize {
    /// The paper's: 3 spans, 1 of them shared.
    fn default() -> Self {
        Self { spans: 3, overlap: 1, room: None }
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
        Ok(Self { spans, overlap, room: None })
    }

    /// Windows of at least so many spans, and of as many more as load no more than `points` points, halo included: long
    /// where the cloud is thin, short where it is dense.
    #[must_use]
    pub fn with_room(self, points: usize) -> Self {
        Self { room: Some(points), ..self }
    }

    /// How many points windows of more spans than they need may load.
    pub fn room(&self) -> Option<usize> {
        self.room
    }

    /// Spans per window, or the least of them where there is room for more.
    pub fn spans(&self) -> usize {
        self.spans
    }

    /// Spans that two consecutive windows share.
    pub fn overlap(&self) -> usize {
        self.overlap
    }

    /// By how many spans the window moves on, or the least of them where there is room for more.
    pub fn advance(&self) -> usize {
        self.spans - self.overlap
    }
}

/// How far around a window's own spans more of the cloud is loaded, only to be looked at.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Halo {
    /// Nothing more.
    #[default]
    None,
    /// All that lies within this length, in units of the coordinates.
    Length(f64),
    /// One span on either side: how far would be enough cannot be told.
    Span,
}

/// How much of the cloud has been loaded around some places, where the rest of it has not been loaded on purpose: lengths in
/// units of the coordinates, on the map or in space, as the neighbors are sought.
#[derive(Debug, Clone, Default)]
pub struct Around {
    radii: FxHashMap<[u64; 3], f64>,
    /// Places around which there may be more at exactly the radius.
    tied: FxHashSet<[u64; 3]>,
}

impl Around {
    /// Notes that all that lies within `radius` of `place` has been loaded; at exactly the radius perhaps not all if it
    /// `is_tied`, but those with the smallest ids.
    pub fn add(&mut self, place: &[f64; 3], radius: f64, is_tied: bool) {
        self.radii.insert(place.map(f64::to_bits), radius);
        if is_tied {
            self.tied.insert(place.map(f64::to_bits));
        }
    }

    /// The same where points have been left out: then others at exactly the radius count that were not loaded.
    fn with_less(mut self) -> Self {
        for place in std::mem::take(&mut self.tied) {
            self.radii.entry(place).and_modify(|radius| *radius = radius.next_down());
        }
        self
    }

    /// How much has been loaded around `place`; less than nothing if it is none of the places.
    fn of(&self, place: &[f64; 3]) -> f64 {
        self.radii.get(&place.map(f64::to_bits)).copied().unwrap_or(f64::NEG_INFINITY)
    }

    fn shrink(&mut self, margin: f64) {
        self.radii.values_mut().for_each(|radius| *radius -= margin);
    }
}

/// What a segmentor sees: the valid points of some consecutive spans.
#[derive(Debug, Clone)]
pub struct Window {
    index: u64,
    spans: Vec<Arc<Span>>,
    /// Which of the spans are the window's own; the others are its halo.
    own_spans: Range<usize>,
    lattice: Lattice,
    points: Vec<[f64; 3]>,
    point_ids: Vec<i64>,
    columns: Columns,
    extent: Option<Extent>,
    /// Where only some places' surroundings have been loaded.
    around: Option<Around>,
    /// Positions of the points among all, where some are left out.
    valid: Option<Vec<u32>>,
    /// Which points are final, where some are not.
    is_final: Option<Vec<bool>>,
    /// Which points may be seeds, where some may not.
    seeds: Option<Vec<bool>>,
    /// The neighbors of all points, where they were kept.
    neighborhoods: Option<Neighborhoods>,
}

impl Window {
    /// Gathers the points of `spans`, all of which are the window's own.
    pub fn new(index: u64, spans: Vec<Arc<Span>>, lattice: Lattice) -> Self {
        let own = 0..spans.len();
        Self::with_halo(index, spans, own, lattice, &[])
    }

    /// Gathers the points of `spans`, of which those in `own` are the window's own; `names` are those of the spans'
    /// attributes.
    pub fn with_halo(index: u64, spans: Vec<Arc<Span>>, own: Range<usize>, lattice: Lattice, names: &[String]) -> Self {
        let total = count(&spans);
        let (mut points, mut point_ids) = (Vec::with_capacity(total), Vec::with_capacity(total));
        for span in &spans {
            points.extend_from_slice(&span.points);
            point_ids.extend((0..span.len()).map(|position| span.point_id(position)));
        }
        let mut columns = Columns::default();
        for (column, name) in names.iter().enumerate() {
            let of_span = |span: &Arc<Span>| span.attributes.get(column).cloned().unwrap_or_default();
            columns.set(name, spans.iter().flat_map(of_span).collect());
        }
        let extent = extent_of(&spans);
        let window = Self {
            index,
            spans,
            own_spans: own,
            lattice,
            points,
            point_ids,
            columns,
            extent,
            around: None,
            valid: None,
            is_final: None,
            seeds: None,
            neighborhoods: None,
        };
        if window.points.iter().all(is_valid) {
            return window;
        }
        let kept: Vec<u32> = (0..total as u32).filter(|&i| is_valid(&window.points[i as usize])).collect();
        window.restricted(&kept)
    }

    /// The same window with only the points at `kept`, in ascending order.
    #[must_use]
    pub fn restricted(&self, kept: &[u32]) -> Self {
        let at = |i: &u32| *i as usize;
        Self {
            index: self.index,
            spans: self.spans.clone(),
            own_spans: self.own_spans.clone(),
            lattice: self.lattice,
            points: kept.iter().map(|i| self.points[at(i)]).collect(),
            point_ids: kept.iter().map(|i| self.point_ids[at(i)]).collect(),
            columns: self.columns.select(kept),
            extent: self.extent,
            around: self.around.clone().map(Around::with_less),
            valid: Some(match &self.valid {
                Some(valid) => kept.iter().map(|i| valid[at(i)]).collect(),
                None => kept.to_vec(),
            }),
            is_final: self.is_final.as_ref().map(|flags| kept.iter().map(|i| flags[at(i)]).collect()),
            seeds: self.seeds.as_ref().map(|flags| kept.iter().map(|i| flags[at(i)]).collect()),
            neighborhoods: self.neighborhoods.as_ref().map(|all| all.restricted(kept)),
        }
    }

    /// The same window with other points in place of its own, such as the centers of voxels.
    #[must_use]
    pub fn replaced(&self, points: Vec<[f64; 3]>, point_ids: Vec<i64>, lattice: Lattice, columns: Columns) -> Self {
        Self {
            index: self.index,
            spans: self.spans.clone(),
            own_spans: self.own_spans.clone(),
            lattice,
            points,
            point_ids,
            columns,
            extent: self.extent.map(|extent| moved(extent, &self.lattice, &lattice)),
            around: self.around.clone(),
            valid: None,
            is_final: None,
            seeds: None,
            neighborhoods: None,
        }
    }

    /// Says that of the cloud only what lies `around` some places has been loaded.
    #[must_use]
    pub fn with_around(self, around: Around) -> Self {
        Self { around: Some(around), ..self }
    }

    /// Number of the window, from 0.
    pub fn index(&self) -> u64 {
        self.index
    }

    /// The spans, halo included, in stream order.
    pub fn spans(&self) -> &[Arc<Span>] {
        &self.spans
    }

    /// The window's own spans, in stream order.
    pub fn own_spans(&self) -> &[Arc<Span>] {
        &self.spans[self.own_spans.clone()]
    }

    /// Which of all points of the spans are the window's own; the others are its halo.
    pub fn own(&self) -> Range<usize> {
        let own = &self.own_spans;
        count(&self.spans[..own.start])..count(&self.spans[..own.end])
    }

    /// Index of the span that a valid point came with, if others have not been put in the points' place.
    pub fn span_of(&self, point: u32) -> u64 {
        let point = self.valid.as_ref().map_or(point, |valid| valid[point as usize]);
        let mut end = 0;
        let holds = |span: &&Arc<Span>| {
            end += span.len();
            (point as usize) < end
        };
        self.spans.iter().find(holds).or(self.spans.last()).map_or(0, |span| span.index)
    }

    /// Lattice coordinates of the valid points, in stream order.
    pub fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// The point ids of the valid points.
    pub fn point_ids(&self) -> &[i64] {
        &self.point_ids
    }

    /// The lattice of the coordinates.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Attributes of the valid points.
    pub fn columns(&self) -> &Columns {
        &self.columns
    }

    /// Attributes of the valid points, to be added to.
    pub fn columns_mut(&mut self) -> &mut Columns {
        &mut self.columns
    }

    /// Positions of the valid points among all points of the spans; none while all are valid.
    pub fn valid(&self) -> Option<&[u32]> {
        self.valid.as_deref()
    }

    /// The part of the map all of whose points this window holds, if its spans are ones of space.
    pub fn extent(&self) -> Option<Extent> {
        self.extent
    }

    /// Makes the part of the map smaller by `margin`, in units of the coordinates, wherever it has a border, because
    /// beyond that something about the points is not final.
    pub fn shrink(&mut self, margin: f64) {
        self.extent = self.extent.map(|extent| extent.shrunk(margin, &self.lattice));
        if let Some(around) = &mut self.around {
            around.shrink(margin);
        }
    }

    /// Whether every point of the cloud within `radius` (in units of the coordinates) of `point` on the map is in this
    /// window. Where spans are cut in stream order nothing is known, and it counts as true.
    pub fn holds(&self, point: &[f64; 3], radius: f64) -> bool {
        self.extent.is_none_or(|extent| extent.holds(point, radius, &self.lattice))
            && self.around.as_ref().is_none_or(|around| around.of(point) >= radius)
    }

    /// How far `point` is from the border of what has been loaded, on the map and in units of the coordinates: 0 if it lies
    /// beyond, ∞ if there is no border.
    pub fn distance_to_border(&self, point: &[f64; 3]) -> f64 {
        let to_border = |extent: Extent| extent.distance_to_border(point, &self.lattice);
        let loaded = self.around.as_ref().map_or(f64::INFINITY, |around| around.of(point).max(0.0));
        self.extent.map_or(f64::INFINITY, to_border).min(loaded)
    }

    /// Whether all that is known of the point is final: no other window can know more.
    pub fn is_final(&self, point: u32) -> bool {
        self.is_final.as_ref().is_none_or(|flags| flags[point as usize])
    }

    /// Says which points are final.
    pub fn set_final(&mut self, is_final: Vec<bool>) {
        self.is_final = Some(is_final).filter(|flags| !flags.iter().all(|flag| *flag));
    }

    /// Whether the point may be the first of a segment.
    pub fn is_seed(&self, point: u32) -> bool {
        self.seeds.as_ref().is_none_or(|flags| flags[point as usize])
    }

    /// Says which points may be the first of a segment.
    pub fn set_seeds(&mut self, seeds: Vec<bool>) {
        self.seeds = Some(seeds);
    }

    /// Which points may be seeds; none if all may.
    pub fn seeds(&self) -> Option<&[bool]> {
        self.seeds.as_deref()
    }

    /// The neighbors of all points, where somebody searched for them already.
    pub fn neighborhoods(&self) -> Option<&Neighborhoods> {
        self.neighborhoods.as_ref()
    }

    /// Keeps the neighbors of all points.
    pub fn set_neighborhoods(&mut self, neighborhoods: Neighborhoods) {
        self.neighborhoods = Some(neighborhoods);
    }

    /// How many points the spans have, valid or not, halo included.
    pub fn len(&self) -> usize {
        count(&self.spans)
    }

    /// Whether the spans have no point.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

fn count(spans: &[Arc<Span>]) -> usize {
    spans.iter().map(|span| span.len()).sum()
}

/// The same part of the map in the horizontal coordinates of another lattice.
fn moved(extent: Extent, from: &Lattice, to: &Lattice) -> Extent {
    if from == to {
        return extent;
    }
    let zero = |lattice: &Lattice| {
        let [x, y] = [0, 1].map(|axis| if lattice.is_whole() { lattice.offset()[axis] } else { 0.0 });
        extent.direction[0] * x + extent.direction[1] * y
    };
    let (from_zero, to_zero) = (zero(from), zero(to));
    let border = |along: f64| (along * from.horizontal_unit() + from_zero - to_zero) / to.horizontal_unit();
    Extent { low: border(extent.low), high: border(extent.high), step: None, ..extent }
}

fn extent_of(spans: &[Arc<Span>]) -> Option<Extent> {
    let (first, last) = (spans.first()?.extent?, spans.last()?.extent?);
    Some(Extent { high: last.high, ..first })
}

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
        self.halo = match halo {
            Halo::Length(length) => Halo::Length(length * (1.0 + 1e-6) / self.lattice.horizontal_unit()),
            halo => halo,
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

    /// The spans of the next window.
    pub(crate) fn next_frame(&mut self) -> Option<Frame> {
        let there = self.held.len() - self.before;
        let end = self.before + self.size.spans.min(there);
        let is_ready = there >= self.size.spans && self.has_halo(end);
        // When the source has ended, the last window may have fewer spans.
        if !(is_ready || self.ended && there > self.shared) {
            return None;
        }
        let end = self.size.room.map_or(Some(end), |room| self.fill(end, room))?;
        Some(self.advance(end))
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
            Halo::Span => self.held.len() > end || self.ends_with_cloud(),
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
        let behind = self.held.range(end..);
        match self.halo {
            Halo::None => 0,
            Halo::Span => behind.take(1).filter(|span| span.extent.is_some()).count(),
            Halo::Length(length) => {
                let own = self.held[end - 1].extent;
                behind
                    .take_while(|span| matches!((span.extent, own), (Some(e), Some(own)) if e.low < own.high + length))
                    .count()
            }
        }
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
        let first = end - self.size.overlap.min(end - self.before);
        self.shared = end - first;
        let kept = first - self.halo_before(first);
        self.held.drain(..kept);
        self.before = first - kept;
        self.index += 1;
        frame
    }

    /// How many spans before `first` belong to the halo.
    fn halo_before(&self, first: usize) -> usize {
        let before = self.held.range(..first).rev();
        match self.halo {
            Halo::None => 0,
            Halo::Span => before.take(1).filter(|span| span.extent.is_some()).count(),
            Halo::Length(length) => {
                let own = self.held.get(first).or(self.held.back()).and_then(|span| span.extent);
                let own_low = own.map(|own| if self.held.len() > first { own.low } else { own.high });
                before
                    .take_while(|span| matches!((span.extent, own_low), (Some(e), Some(low)) if e.high > low - length))
                    .count()
            }
        }
    }
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

    #[test]
    fn a_window_has_to_move() {
        assert!(WindowSize::new(3, 3).unwrap_err().to_string().contains("overlap is 3 of 3 spans"));
        assert!(WindowSize::new(0, 0).is_err());
    }

    #[test]
    fn invalid_points_are_kept_from_the_segmentor() {
        let points = vec![[0.0; 3], [f64::NAN; 3], [1.0; 3]];
        let point_ids = PointIds::Listed(vec![4, 7, 9]);
        let span = Span { index: 0, point_ids, points, attributes: vec![], extent: None };
        let window = Window::new(0, vec![Arc::new(span)], Lattice::REAL);
        assert_eq!(window.points().len(), 2);
        assert_eq!(window.valid(), Some(&[0, 2][..]));
        assert_eq!(window.point_ids(), [4, 9]);
        assert_eq!(window.len(), 3);
    }
}
