//! Segments that are one because of what a window says of points beyond its own.
//!
//! A window has seen that a label of its own holds a point of another span. If that point has a segment already, the two
//! are joined at once; if its own window is still to come, what it was seen as waits for it. Points that have gone out of
//! scope are looked up in a temporary file, where that can be asked for.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};

use crate::error::{Error, Result};
use crate::label::{NONE, SegmentId};
use crate::look::Sight;
use crate::weaver::{EvictedSpan, OutOfScope, Weaver};

/// What windows have seen beyond their own spans.
pub struct Sightings {
    /// By span: the segment that each point was seen in, as long as it has none of its own.
    open: BTreeMap<u64, Vec<SegmentId>>,
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
        let mut seen: Vec<SegmentId> = self.open.values().flatten().copied().filter(|id| *id != NONE).collect();
        seen.sort_unstable();
        seen.dedup();
        weaver.await_segments(&seen);
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
                let (seen, position) = (first_id + SegmentId::from(sight.label), sight.position as usize);
                let segment_id = match &known {
                    Some(ids) => ids.get(position).copied().filter(|id| *id != NONE),
                    None => weaver.raw_id(span, position).or_else(|| self.note(span, position, seen)),
                };
                pairs.extend(segment_id.map(|segment_id| [segment_id, seen]));
            }
        }
        pairs.retain(|[a, b]| a != b);
        pairs.sort_unstable();
        pairs.dedup();
        Ok(pairs)
    }

    /// Notes in which segment a point was seen; returns the one in which it had been seen before.
    fn note(&mut self, span: u64, position: usize, seen: SegmentId) -> Option<SegmentId> {
        let points = self.open.entry(span).or_default();
        if points.len() <= position {
            points.resize(position + 1, NONE);
        }
        Some(std::mem::replace(&mut points[position], seen)).filter(|before| *before != NONE)
    }

    /// The pairs of those points that have got a segment of their own since they were seen.
    fn met(&mut self, weaver: &Weaver) -> Vec<[SegmentId; 2]> {
        let mut pairs = Vec::new();
        for (&span, points) in &mut self.open {
            for (position, seen) in points.iter_mut().enumerate().filter(|(_, seen)| **seen != NONE) {
                if let Some(own) = weaver.raw_id(span, position) {
                    pairs.push([own, std::mem::replace(seen, NONE)]);
                }
            }
        }
        self.open.retain(|_, points| points.iter().any(|seen| *seen != NONE));
        pairs
    }
}

/// The segment ids of all points that have gone out of scope, in a temporary file.
#[derive(Debug, Default)]
struct Gone {
    file: Option<File>,
    /// Where the ids of each span end.
    ends: Vec<u64>,
}

impl Gone {
    /// Keeps the ids of the next span.
    fn keep(&mut self, ids: &[SegmentId]) -> Result<()> {
        let end = self.ends.last().copied().unwrap_or(0);
        let mut write = || {
            let file = match &mut self.file {
                Some(file) => file,
                none => none.insert(tempfile::tempfile()?),
            };
            file.seek(SeekFrom::Start(end))?;
            file.write_all(bytemuck::cast_slice(ids))
        };
        write().map_err(|e| Error::spool("written", e))?;
        self.ends.push(end + size_of_val(ids) as u64);
        Ok(())
    }

    /// The ids of a span; none if it is in scope or yet to come.
    fn of(&mut self, span: u64) -> Result<Option<Vec<SegmentId>>> {
        let (Some(&end), Some(file)) = (self.ends.get(span as usize), &mut self.file) else { return Ok(None) };
        let start = if span == 0 { 0 } else { self.ends[span as usize - 1] };
        let mut ids = vec![NONE; (end - start) as usize / size_of::<SegmentId>()];
        let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(bytemuck::cast_slice_mut(&mut ids)));
        read.map_err(|e| Error::spool("read", e))?;
        Ok(Some(ids))
    }
}
