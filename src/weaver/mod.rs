//! The WEAVER of the framework: labels of overlapping windows in, segment ids out.
//!
//! Source: moving-window segmentation (ISPRS Annals I-3, 2012, section 2.1.2 and figure 1). With its two look-up tables,
//! for each window in order:
//!
//! 1. *Evict.* Points that are in neither this window nor the one before go out of scope, and so do segments none of
//!    whose points are in scope. What the tables knew of them is written to the history and dropped.
//! 2. *Number.* The window's labels become segment ids, going on from the last.
//! 3. *Look up* every point in the point-segment table ([`PointSegment`]). If it is there, nothing further is done for
//!    that table, but its segment and the point's segment in this window are a pair. If not, it is added.
//! 4. *Connect* the pairs in the segment-segment table ([`SegmentSegment`]); segments without a pair have none.
//! 5. *Carry* the ids over: segments that are connected are one, and the smallest id stands for them ([`Carry`]). Late
//!    joins are aliases ([`Aliases`]).
//! 6. *Close* the wholes that have gone out of scope altogether: their sizes are known, so in the end some can be left
//!    out, and the others be ordered ([`Selection`]).
//!
//! Whoever labels the windows can ask for more than shared points: segments that do not *agree* are no pair, and a whole
//! none of whose labels holds a *seed* is left out in the end.
//!
//! Segments can also be joined later, by something else than the points that two windows share ([`Weaver::join_late`]): when
//! a pair at the border of a window has been decided at last, or points came back ([`Returned`]).
//!
//! The weaver never sees a coordinate. Steps 3 and 4 run on any number of threads, the ids do not depend on it.
//!
//! Departure: a point without a label has no entry in the table, so a later window may still give it one. Until then the
//! table knows why it has none, and that is counted when the point goes out of scope.

mod aliases;
mod carry;
mod ledger;
mod out_of_scope;
mod point_segment;
mod replay;
mod segment_segment;
mod selection;
mod settling;

use std::collections::{BTreeSet, VecDeque};
use std::ops::Range;

pub use aliases::Aliases;
pub use carry::{Carry, Closed, Join, LateJoin};
pub use out_of_scope::OutOfScope;
pub use point_segment::{Inserted, PointSegment};
pub use replay::Replay;
pub use segment_segment::{Pairs, SegmentRow, SegmentSegment};
pub use selection::Selection;
pub use settling::Settling;

use crate::crew::Crew;
use crate::error::Result;
use crate::label::{ByCause, Cause, Labels, NONE, SegmentId};

/// Points that one thread weaves at a time.
const STRETCH: usize = 1 << 15;

/// Ties the labels of overlapping windows together.
pub struct Weaver {
    points: PointSegment,
    segments: SegmentSegment,
    carry: Carry,
    aliases: Aliases,
    /// Spans in scope, oldest first.
    spans: VecDeque<LiveSpan>,
    /// The first span of the window before.
    previous_first: u64,
    /// Late joins that no evicted span has told yet.
    untold: Vec<[SegmentId; 2]>,
    /// Segments without a seed that no evicted span has told yet.
    untold_seedless: Vec<SegmentId>,
    /// Rows of late joins whose earlier segment is in scope yet, or has gone since the last span.
    late_rows: BTreeSet<SegmentRow>,
    joins: i64,
}

#[derive(Debug, Clone, Copy)]
struct LiveSpan {
    index: u64,
    first_arrival: u64,
    points: usize,
}

/// A segmented window, as far as the weaver needs to know it.
pub struct LabelledWindow<'a> {
    /// Number of the window.
    pub index: u64,
    /// Index of its first span; the others follow.
    pub first_span: u64,
    /// How many points each span has.
    pub span_points: &'a [usize],
    /// One label per point, span by span.
    pub labels: &'a Labels,
    /// For each label, whether one of its points may be a seed; none = every label has one.
    pub seeded: Option<&'a [bool]>,
    /// Asked once for each segment of an earlier window and each label of this that share points; where it says no they
    /// are not a pair. None = sharing points is enough.
    pub agrees: Option<&'a Agreement<'a>>,
}

/// A segment of an earlier window, in scope or not, some of whose points were looked at again in a later window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Returned {
    /// The segment.
    pub segment_id: SegmentId,
    /// What the later window says of the points.
    pub label: i32,
    /// How many points.
    pub points: u64,
}

/// Whether a segment in scope and a label of the window agree to be one; the answer depends on the two alone.
pub type Agreement<'a> = dyn Fn(SegmentId, i32) -> bool + Sync + 'a;

/// What is known of a span when it goes out of scope.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EvictedSpan {
    /// Which span.
    pub index: u64,
    /// The raw segment id of each point: the one it got in the first window that labelled it.
    pub raw_ids: Vec<SegmentId>,
    /// The segment id carried over from window to window.
    pub carried_ids: Vec<SegmentId>,
    /// Why points have none.
    pub unlabelled: ByCause,
    /// The segments that went with the span, then late joins of segments that had gone already.
    pub segments: Vec<SegmentRow>,
    /// How many of the rows are late joins.
    pub late_joins: usize,
    /// Late joins since the last span: an id that has been handed out, and what it has become.
    pub aliases: Vec<[SegmentId; 2]>,
    /// The segments without a seed of the windows woven since the last span.
    pub seedless: Vec<SegmentId>,
    /// Where the log stood; [`Settling::rewind`] to here makes the carried ids final.
    pub settles_at: u64,
}

/// A run of points that are in one segment of an earlier window and one of this.
struct Run {
    from: SegmentId,
    label: i32,
    points: u64,
}

impl Default for Weaver {
    fn default() -> Self {
        Self {
            points: PointSegment::with_capacity(STRETCH),
            segments: SegmentSegment::default(),
            carry: Carry::default(),
            aliases: Aliases::default(),
            spans: VecDeque::new(),
            previous_first: 0,
            untold: Vec::new(),
            untold_seedless: Vec::new(),
            late_rows: BTreeSet::new(),
            joins: 0,
        }
    }
}

impl Weaver {
    /// A weaver that can join segments after they have gone out of scope, as far as they are remembered.
    pub fn with_late_joins(out_of_scope: OutOfScope) -> Self {
        Self { carry: Carry::new(out_of_scope), ..Self::default() }
    }

    /// Weaves the next window; returns the spans that go out of scope, in order.
    pub fn weave(&mut self, window: &LabelledWindow<'_>, crew: &Crew) -> Vec<EvictedSpan> {
        let evicted = self.evict_before(self.previous_first);
        self.previous_first = window.first_span;
        let first_id = self.carry.next_id();
        self.aliases.mark_births(first_id);
        self.bear(window, first_id);

        let first_arrival = self.take_in(window);
        let runs = self.look_up(window.labels.of_points(), first_arrival, first_id, crew);
        let mut pairs = self.connect(runs, first_id, crew);
        if let Some(agrees) = window.agrees {
            pairs.retain(|&(from, label, _)| agrees(from, label));
        }
        self.segments.push(window.index, first_id, &last_spans(window), &pairs);
        for row in self.segments.newest_pairs() {
            if let Some(join) = self.carry.join(row.segment_id, row.next_segment_id) {
                tell(&join, &mut self.aliases, &mut self.untold);
                self.joins += 1;
            }
        }
        evicted
    }

    /// Ends the stream: everything left goes out of scope.
    pub fn finish(&mut self) -> Vec<EvictedSpan> {
        self.evict_before(u64::MAX)
    }

    /// Joins earlier segments, in scope or not, with labels of the window just woven, whose label 0 is the segment
    /// `first_id`: they share points that are not among its own.
    ///
    /// Here what is remembered of segments out of scope goes to disk, so this is called after each window, even if none returns:
    /// a disk that is full stops late joins, and what goes out of scope stays whole.
    ///
    /// # Errors
    /// If a segment returns that is not remembered, or the disk fails.
    pub fn join_returned(&mut self, returned: &[Returned], first_id: SegmentId, window: u64) -> Result<()> {
        returned.iter().try_for_each(|&Returned { segment_id, label, points }| {
            self.join_any(segment_id, first_id + SegmentId::from(label), window, points)
        })?;
        self.carry.spill()
    }

    /// Joins pairs of segments that were found to be one by something else than shared points, with the window that
    /// brought it to light. They may have gone out of scope, if they are remembered; what is, goes to disk here, too.
    ///
    /// # Errors
    /// If a segment is not known any more, or the disk fails.
    pub fn join_late(&mut self, pairs: &[[SegmentId; 2]], window: u64) -> Result<()> {
        pairs.iter().try_for_each(|&[a, b]| self.join_any(a, b, window, 0))?;
        self.carry.spill()
    }

    /// Says anew which segments may be named by a late join when they have gone out of scope.
    pub fn await_segments(&mut self, ids: &[SegmentId]) {
        self.carry.await_only(ids);
    }

    fn join_any(&mut self, a: SegmentId, b: SegmentId, window: u64, shared_points: u64) -> Result<()> {
        let (segment_id, next_segment_id) = (a.min(b), a.max(b));
        if segment_id == next_segment_id {
            return Ok(());
        }
        let late = self.carry.join_late(segment_id, next_segment_id)?;
        late.reopened.into_iter().for_each(|id| self.aliases.reopen(id));
        if let Some(join) = late.join {
            tell(&join, &mut self.aliases, &mut self.untold);
            self.joins += 1;
        }
        if let Some(whole) = late.closed {
            self.aliases.close(&whole);
        }
        self.late_rows.insert(SegmentRow { segment_id, next_segment_id, window: window as i64, shared_points });
        Ok(())
    }

    /// The rows of late joins whose earlier segment has told its own rows: all older ones have gone.
    fn told_late_rows(&mut self) -> BTreeSet<SegmentRow> {
        let first =
            SegmentRow { segment_id: self.oldest_live_id(), next_segment_id: NONE, window: NONE, shared_points: 0 };
        let kept = self.late_rows.split_off(&first);
        std::mem::replace(&mut self.late_rows, kept)
    }

    /// Gives the window's labels their segment ids.
    fn bear(&mut self, window: &LabelledWindow<'_>, first_id: SegmentId) {
        self.carry.extend(window.labels.count(), window.seeded.is_none());
        for (segment_id, &is_seeded) in (first_id..).zip(window.seeded.unwrap_or_default()) {
            if is_seeded {
                self.carry.seed(segment_id);
            } else {
                self.untold_seedless.push(segment_id);
            }
        }
    }

    /// Makes room for the window's new spans; returns the arrival of the window's first point.
    fn take_in(&mut self, window: &LabelledWindow<'_>) -> u64 {
        let known = self.spans.back().map_or(0, |span| span.index + 1);
        for (index, &points) in (window.first_span..).zip(window.span_points) {
            if index >= known {
                let first_arrival = self.points.extend(points);
                self.spans.push_back(LiveSpan { index, first_arrival, points });
            }
        }
        let first = self.spans.iter().find(|span| span.index == window.first_span);
        first.map_or(0, |span| span.first_arrival)
    }

    /// Looks every labelled point up, adds the new ones and returns the runs of those that were there. Notes of the others
    /// why they have no label.
    fn look_up(&self, labels: &[i32], first_arrival: u64, first_id: SegmentId, crew: &Crew) -> Vec<Vec<Run>> {
        let table = &self.points;
        crew.map(stretches(labels.len()), |stretch| {
            let mut runs: Vec<Run> = Vec::new();
            for (arrival, &label) in (first_arrival + stretch.start as u64..).zip(&labels[stretch]) {
                if let Some(cause) = Cause::of_label(label) {
                    table.explain(arrival, cause);
                    continue;
                }
                if let Inserted::Kept(from) = table.insert_if_absent(arrival, first_id + SegmentId::from(label)) {
                    match runs.last_mut() {
                        Some(run) if run.from == from && run.label == label => run.points += 1,
                        _ => runs.push(Run { from, label, points: 1 }),
                    }
                }
            }
            runs
        })
    }

    /// Counts the pairs that the runs show.
    fn connect(&self, runs: Vec<Vec<Run>>, first_id: SegmentId, crew: &Crew) -> Vec<(SegmentId, i32, u64)> {
        let capacity = runs.iter().map(Vec::len).sum();
        let pairs = Pairs::new(self.segments.oldest_id().unwrap_or(first_id), capacity);
        crew.map(runs, |runs| runs.iter().for_each(|run| pairs.add(run.from, run.label, run.points)));
        pairs.seal()
    }

    fn evict_before(&mut self, first_span: u64) -> Vec<EvictedSpan> {
        let mut evicted = Vec::new();
        while let Some(&span) = self.spans.front().filter(|span| span.index < first_span) {
            self.spans.pop_front();
            evicted.push(self.evict(span));
        }
        if let Some(last) = evicted.last_mut() {
            let late = self.told_late_rows();
            last.late_joins = late.len();
            last.segments.extend(late);
            // After the spans have noted where the log stands, so that it is read before them.
            for whole in self.carry.evict_before(self.oldest_live_id()) {
                self.aliases.close(&whole);
            }
        }
        evicted
    }

    fn evict(&mut self, span: LiveSpan) -> EvictedSpan {
        let end = span.first_arrival + span.points as u64;
        let mut unlabelled = ByCause::default();
        let raw_id = |arrival| {
            self.points.find(arrival).unwrap_or_else(|cause| {
                unlabelled.add(cause, 1);
                NONE
            })
        };
        let raw_ids: Vec<SegmentId> = (span.first_arrival..end).map(raw_id).collect();
        let mut carried_ids = raw_ids.clone();
        for run in carried_ids.chunk_by_mut(|a, b| a == b) {
            if run[0] != NONE {
                run.fill(self.carry.hand_out(run[0], run.len()));
            }
        }
        self.points.evict_before(end);
        EvictedSpan {
            index: span.index,
            raw_ids,
            carried_ids,
            unlabelled,
            segments: self.segments.evict_with(span.index),
            late_joins: 0,
            aliases: std::mem::take(&mut self.untold),
            seedless: std::mem::take(&mut self.untold_seedless),
            settles_at: self.aliases.len(),
        }
    }

    /// The log of joins and closings.
    pub fn aliases(&mut self) -> &mut Aliases {
        &mut self.aliases
    }

    /// The id that the next new segment gets.
    pub fn next_id(&self) -> SegmentId {
        self.carry.next_id()
    }

    /// No segment with a smaller id than this is in scope, so what is kept for such segments can be forgotten. The next
    /// new id if no segment is in scope.
    pub fn oldest_live_id(&self) -> SegmentId {
        self.segments.oldest_id().unwrap_or_else(|| self.next_id())
    }

    /// The raw segment id of the point at `position` of a span in scope; none if it has none, or the span is not in scope.
    pub fn raw_id(&self, span: u64, position: usize) -> Option<SegmentId> {
        let first = self.spans.front()?.index;
        let span = self.spans.get(span.checked_sub(first)? as usize)?;
        self.points.get(span.first_arrival + position as u64).filter(|_| position < span.points)
    }

    /// How many times two segments have become one.
    pub fn joins(&self) -> i64 {
        self.joins
    }

    /// How many points have an entry in the point-segment table, counted one by one.
    pub fn live_points(&self) -> usize {
        self.points.live()
    }

    /// How many segments have an entry in the segment-segment table.
    pub fn live_segments(&self) -> usize {
        self.segments.live()
    }
}

/// Notes a join, and tells it to those who hold the larger id already.
fn tell(join: &Join, aliases: &mut Aliases, untold: &mut Vec<[SegmentId; 2]>) {
    aliases.join(join.id, join.becomes);
    if join.is_alias {
        untold.push([join.id, join.becomes]);
    }
}

/// The last span that holds a point of each label.
fn last_spans(window: &LabelledWindow<'_>) -> Vec<u64> {
    let mut last = vec![window.first_span; window.labels.count()];
    let mut labels = window.labels.of_points();
    for (span, &points) in (window.first_span..).zip(window.span_points) {
        let (of_span, rest) = labels.split_at(points);
        for &label in of_span.iter().filter(|label| **label >= 0) {
            last[label as usize] = span;
        }
        labels = rest;
    }
    last
}

fn stretches(points: usize) -> Vec<Range<usize>> {
    (0..points).step_by(STRETCH).map(|start| start..(start + STRETCH).min(points)).collect()
}
