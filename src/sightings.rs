//! Segments that are one because of what a window says of points beyond its own.
//!
//! A window has seen that a label of its own holds a point of another span. If that point has a segment already, the two
//! are joined at once; if its own window is still to come, what it was seen as waits for it. Points that have gone out of
//! scope are looked up in a temporary file, where that can be asked for.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

use crate::disk::WordFile;
use crate::error::Result;
use crate::label::{NONE, SegmentId};
use crate::look::Sight;
use crate::weaver::{EvictedSpan, OutOfScope, Weaver};

/// What windows have seen beyond their own spans.
pub struct Sightings {
    /// By span and position: the segment that a point was seen in, as long as it has none of its own.
    open: BTreeMap<u64, FxHashMap<u32, SegmentId>>,
    gone: Option<Gone>,
}

impl Sightings {
    /// Nothing seen yet; `far` if points that have gone out of scope may be seen, too.
    pub fn new(far: bool) -> Self {
        Self { open: BTreeMap::new(), gone: far.then(Gone::default) }
    }

    /// What has to be remembered of segments that have gone out of scope.
    pub fn out_of_scope(&self) -> OutOfScope {
        if self.gone.is_some() { OutOfScope::all() } else { OutOfScope::awaited() }
    }

    /// Joins what a window that has been woven shows to be one; its segments' ids start from `first_id`, and `evicted` went
    /// with it.
    ///
    /// # Errors
    /// If the temporary file cannot be written or read.
    pub fn join(
        &mut self,
        sights: &[Sight],
        first_id: SegmentId,
        window: u64,
        evicted: &[EvictedSpan],
        weaver: &mut Weaver,
    ) -> Result<()> {
        let pairs = self.pairs(sights, first_id, evicted, weaver)?;
        weaver.join_late(&pairs, window)?;
        if self.gone.is_none() {
            let mut seen: Vec<SegmentId> = self.open.values().flat_map(FxHashMap::values).copied().collect();
            seen.sort_unstable();
            seen.dedup();
            weaver.await_segments(&seen);
        }
        Ok(())
    }

    /// The pairs of segments that are one.
    fn pairs(
        &mut self,
        sights: &[Sight],
        first_id: SegmentId,
        evicted: &[EvictedSpan],
        weaver: &Weaver,
    ) -> Result<Vec<[SegmentId; 2]>> {
        for span in evicted {
            self.open.remove(&span.index);
            if let Some(gone) = &mut self.gone {
                gone.keep(&span.raw_ids)?;
            }
        }
        let mut pairs = self.met(weaver);
        for sights in sights.chunk_by(|a, b| a.span == b.span) {
            let span = sights[0].span;
            let known = match &mut self.gone {
                Some(gone) => gone.of(span)?,
                None => None,
            };
            for sight in sights {
                let (seen, position) = (first_id + SegmentId::from(sight.label), sight.position);
                let segment_id = match &known {
                    Some(ids) => ids.get(position as usize).copied().filter(|id| *id != NONE),
                    // Unless it has a segment of its own, it is the one in which it had been seen before.
                    None => weaver
                        .raw_id(span, position as usize)
                        .or_else(|| self.open.entry(span).or_default().insert(position, seen)),
                };
                pairs.extend(segment_id.map(|segment_id| [segment_id, seen]));
            }
        }
        pairs.retain(|[a, b]| a != b);
        pairs.sort_unstable();
        pairs.dedup();
        Ok(pairs)
    }

    /// The pairs of those points that have got a segment of their own since they were seen.
    fn met(&mut self, weaver: &Weaver) -> Vec<[SegmentId; 2]> {
        let mut pairs = Vec::new();
        self.open.retain(|&span, points| {
            points.retain(|&position, &mut seen| {
                let own = weaver.raw_id(span, position as usize);
                pairs.extend(own.map(|own| [own, seen]));
                own.is_none()
            });
            !points.is_empty()
        });
        pairs
    }
}

/// The segment ids of all points that have gone out of scope, in a temporary file.
#[derive(Debug, Default)]
struct Gone {
    file: WordFile,
    /// Where the ids of each span end.
    ends: Vec<u64>,
}

impl Gone {
    /// Keeps the ids of the next span.
    fn keep(&mut self, ids: &[SegmentId]) -> Result<()> {
        let end = self.ends.last().copied().unwrap_or(0);
        self.file.write_at(end, ids)?;
        self.ends.push(end + size_of_val(ids) as u64);
        Ok(())
    }

    /// The ids of a span; none if it is in scope or yet to come.
    fn of(&mut self, span: u64) -> Result<Option<Vec<SegmentId>>> {
        let Some(&end) = self.ends.get(span as usize) else { return Ok(None) };
        let start = if span == 0 { 0 } else { self.ends[span as usize - 1] };
        self.file.read_at(start, (end - start) as usize / size_of::<SegmentId>()).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crew::Crew;
    use crate::label::Labels;
    use crate::weaver::LabelledWindow;

    #[test]
    fn a_point_far_into_a_span_that_two_segments_are_seen_to_hold_makes_them_one() {
        for far in [false, true] {
            let mut sightings = Sightings::new(far);
            let mut weaver = Weaver::with_late_joins(sightings.out_of_scope());
            let labels = &Labels::from_any(&[0, 1]);
            let window =
                LabelledWindow { index: 0, first_span: 0, span_points: &[2], labels, seeded: None, agrees: None };
            weaver.weave(&window, &Crew::of_one());
            // Memory for all points before it would not be there.
            let sight = |label| Sight { label, span: 9, position: u32::MAX };
            sightings.join(&[sight(0)], 1, 0, &[], &mut weaver).unwrap();
            assert_eq!(weaver.joins(), 0);
            sightings.join(&[sight(1)], 1, 0, &[], &mut weaver).unwrap();
            assert_eq!(weaver.joins(), 1);
        }
    }
}
