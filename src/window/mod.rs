//! Windows: the spans that are segmented together, sliding over the stream.
//!
//! Source: moving-window segmentation (ISPRS Annals I-3, 2012): windows of 3 spans that overlap by 1, so the window moves on by
//! 2. Number and overlap are free as long as the window moves ([`WindowSize`]). Departure: a window may load a [`Halo`] around its
//! own spans, which is only looked at.

mod around;
mod size;
mod slider;

use std::ops::Range;
use std::sync::Arc;

pub use around::Around;
pub use size::{Halo, WindowSize};
pub(crate) use slider::Frame;
pub use slider::Slider;

use crate::attribute::Columns;
use crate::lattice::{Lattice, is_valid};
use crate::neighborhood::Neighborhoods;
use crate::span::{Extent, Span};

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::PointIds;

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
