//! The weaver, read out of the text: two look-up tables, filled and emptied window by window, one point at a time.
//!
//! Source: moving-window segmentation (ISPRS Annals I-3, 2012, section 2.1.2). Ids are carried by connecting every pair
//! that was ever seen and taking the smallest id; nothing of that is forgotten.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::partition::components;
use streamseg::label::{NONE, SegmentId};
use streamseg::weaver::{Closed, SegmentRow};

/// A point: its span and its position there.
type Point = (u64, usize);

/// The two tables, and the history so far.
#[derive(Default)]
pub struct SequentialWeaver {
    /// One segment per point.
    pub point_segment: HashMap<Point, SegmentId>,
    /// Many next segments per segment, each with the window and the number of points shared.
    pub segment_segment: BTreeMap<SegmentId, BTreeMap<SegmentId, (i64, u64)>>,
    points_of: HashMap<SegmentId, Vec<Point>>,
    /// Spans in scope, with their points.
    spans: BTreeMap<u64, usize>,
    previous_first: u64,
    segments: SegmentId,
    pairs: Vec<(usize, usize)>,
    /// Every point that was ever labelled, with its raw segment.
    counted: HashMap<Point, SegmentId>,
    /// Segments that hold a seed.
    seeded: BTreeSet<SegmentId>,
}

/// What a segmentor says of a window.
pub struct Said<'a> {
    pub labels: &'a [i32],
    /// Whether a label holds a seed.
    pub is_seeded: &'a dyn Fn(i32) -> bool,
    /// Whether an earlier segment and a label may be one.
    pub agrees: &'a dyn Fn(SegmentId, i32) -> bool,
}

/// What leaves with a span.
#[derive(Debug, PartialEq)]
pub struct Gone {
    pub span: u64,
    pub raw_ids: Vec<SegmentId>,
    pub carried_ids: Vec<SegmentId>,
    pub segments: Vec<SegmentRow>,
}

impl SequentialWeaver {
    /// Weaves a window whose spans have so many points each and of whose points this was said.
    pub fn weave(&mut self, window: i64, first_span: u64, span_points: &[usize], said: &Said<'_>) -> Vec<Gone> {
        let gone = self.let_go_before(self.previous_first);
        self.previous_first = first_span;
        let spans = (first_span..).zip(span_points.iter().copied());
        self.spans.extend(spans.clone());
        let first_id = self.segments + 1;
        let points = spans.flat_map(|(span, points)| (0..points).map(move |position| (span, position)));
        for (point, &label) in points.zip(said.labels).filter(|(_, label)| **label >= 0) {
            let segment = first_id + SegmentId::from(label);
            self.segments = self.segments.max(segment);
            self.segment_segment.entry(segment).or_default();
            self.points_of.entry(segment).or_default().push(point);
            self.counted.entry(point).or_insert(segment);
            if (said.is_seeded)(label) {
                self.seeded.insert(segment);
            }
            match self.point_segment.get(&point) {
                None => {
                    self.point_segment.insert(point, segment);
                }
                Some(&before) if (said.agrees)(before, label) => self.connect(before, segment, window),
                Some(_) => (),
            }
        }
        gone
    }

    /// Joins two segments for another reason than a point that they share.
    pub fn join(&mut self, a: SegmentId, b: SegmentId) {
        self.pairs.push((a as usize, b as usize));
    }

    /// The id that the next segment gets.
    pub fn next_id(&self) -> SegmentId {
        self.segments + 1
    }

    fn connect(&mut self, before: SegmentId, segment: SegmentId, window: i64) {
        let next = self.segment_segment.get_mut(&before).expect("a segment with a point in scope is in scope");
        next.entry(segment).or_insert((window, 0)).1 += 1;
        self.pairs.push((before as usize, segment as usize));
    }

    /// Ends the stream.
    pub fn finish(&mut self) -> Vec<Gone> {
        self.let_go_before(u64::MAX)
    }

    /// The smallest id of the component of each id, as far as is known; by id.
    pub fn carried(&self) -> Vec<SegmentId> {
        components(self.segments as usize + 1, self.pairs.iter().copied())
    }

    /// Every whole that there is after the end, by id: its points, each counted once, and whether one is a seed.
    pub fn wholes(&self) -> Vec<Closed> {
        let whole_of = self.carried();
        let mut wholes: BTreeMap<SegmentId, Closed> = BTreeMap::new();
        for segment in 1..=self.segments {
            let id = whole_of[segment as usize];
            let whole = wholes.entry(id).or_insert(Closed { id, points: 0, has_seed: false });
            whole.points += self.counted.values().filter(|raw| **raw == segment).count() as u64;
            whole.has_seed |= self.seeded.contains(&segment);
        }
        wholes.into_values().collect()
    }

    /// Which wholes no later window can touch: none of their points is in scope.
    pub fn closed(&self) -> Vec<SegmentId> {
        let whole_of = self.carried();
        let open: BTreeSet<SegmentId> = self.points_of.keys().map(|&segment| whole_of[segment as usize]).collect();
        let wholes: BTreeSet<SegmentId> = whole_of[1..].iter().copied().collect();
        wholes.difference(&open).copied().collect()
    }

    fn let_go_before(&mut self, first_span: u64) -> Vec<Gone> {
        let leaving: Vec<(u64, usize)> =
            self.spans.range(..first_span).map(|(&span, &points)| (span, points)).collect();
        let carried = if leaving.is_empty() { Vec::new() } else { self.carried() };
        let mut gone = Vec::new();
        for (span, points) in leaving {
            let raw = |position| self.point_segment.get(&(span, position)).copied().unwrap_or(NONE);
            let raw_ids: Vec<SegmentId> = (0..points).map(raw).collect();
            let carry = |&id: &SegmentId| if id == NONE { NONE } else { carried[id as usize] };
            let carried_ids = raw_ids.iter().map(carry).collect();
            self.spans.remove(&span);
            self.point_segment.retain(|point, _| point.0 != span);
            gone.push(Gone { span, raw_ids, carried_ids, segments: self.segments_out_of_scope() });
        }
        gone
    }

    fn segments_out_of_scope(&mut self) -> Vec<SegmentRow> {
        let in_scope: BTreeSet<u64> = self.spans.keys().copied().collect();
        let out = |points: &Vec<Point>| points.iter().all(|(span, _)| !in_scope.contains(span));
        let mut leaving: Vec<SegmentId> =
            self.points_of.iter().filter(|(_, points)| out(points)).map(|(&segment, _)| segment).collect();
        leaving.sort_unstable();
        leaving.into_iter().flat_map(|segment| self.rows_of(segment)).collect()
    }

    fn rows_of(&mut self, segment_id: SegmentId) -> Vec<SegmentRow> {
        self.points_of.remove(&segment_id);
        let next = self.segment_segment.remove(&segment_id).unwrap_or_default();
        let row =
            |next_segment_id, window, shared_points| SegmentRow { segment_id, next_segment_id, window, shared_points };
        if next.is_empty() {
            return vec![row(NONE, NONE, 0)];
        }
        next.into_iter().map(|(next, (window, shared))| row(next, window, shared)).collect()
    }
}
