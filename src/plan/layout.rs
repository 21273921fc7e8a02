//! Which windows there will be: told from counts of points per slab, before a point is segmented.

use super::census::Counts;
use crate::window::{Halo, WindowSize};

/// A window to come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedWindow {
    /// How many spans it has of its own.
    pub spans: usize,
    /// How far its own spans reach, in units of the coordinates.
    pub length: f64,
    /// How many points these have.
    pub own: u64,
    /// How many points it loads, halo included.
    pub loaded: u64,
}

/// A span to come, in numbers of slabs. What lies before the first and behind the last is known to be empty.
#[derive(Debug, Clone, Copy)]
struct PlannedSpan {
    low: f64,
    high: f64,
    points: u64,
}

/// The windows over slabs with these counts, consecutive ones of which are one span while they hold no more than `most`
/// points.
pub fn windows(counts: &Counts, most: u64, size: WindowSize, halo: Halo) -> Vec<PlannedWindow> {
    let slabs = counts.slabs();
    let spans = spans(&slabs, most);
    // As the slider has it: borders may have been moved by rounding.
    let in_slabs = |length: f64| length * (1.0 + 1e-6) / counts.width();
    let points = |from: usize, end: usize| spans[from..end].iter().map(|span| span.points).sum::<u64>();
    let within = |first: usize, end: usize, length: f64| {
        let from = spans.partition_point(|span| span.high <= spans[first].low - length);
        (from.min(first), spans.partition_point(|span| span.low < spans[end - 1].high + length).max(end))
    };
    let loaded = |first: usize, end: usize| match halo {
        Halo::None => points(first, end),
        Halo::Length(length) => {
            let (from, to) = within(first, end, in_slabs(length));
            points(from, to)
        }
        Halo::SpanBeyond(length) => {
            let (from, to) = within(first, end, in_slabs(length));
            points(from.saturating_sub(1), (to + 1).min(spans.len()))
        }
    };
    let room = size.room().map_or(0, |room| room as u64);
    let (mut windows, mut first) = (Vec::new(), 0);
    loop {
        let mut end = (first + size.spans()).min(spans.len());
        while end < spans.len() && loaded(first, end + 1) <= room {
            end += 1;
        }
        if end > first {
            let (low, high) = (spans[first].low, spans[end - 1].high);
            let length = (high.min(last_of(&slabs)) - low.max(first_of(&slabs))) * counts.width();
            windows.push(PlannedWindow {
                spans: end - first,
                length,
                own: points(first, end),
                loaded: loaded(first, end),
            });
        }
        if end == spans.len() {
            return windows;
        }
        first = end - size.overlap();
    }
}

fn first_of(slabs: &[(i64, u64)]) -> f64 {
    slabs.first().map_or(0.0, |slab| slab.0 as f64)
}

fn last_of(slabs: &[(i64, u64)]) -> f64 {
    slabs.last().map_or(0.0, |slab| (slab.0 + 1) as f64)
}

fn spans(slabs: &[(i64, u64)], most: u64) -> Vec<PlannedSpan> {
    let mut spans: Vec<PlannedSpan> = Vec::new();
    for &(slab, points) in slabs {
        match spans.last_mut() {
            Some(span) if span.points + points <= most => span.points += points,
            last => {
                let low = if last.is_some() { slab as f64 } else { f64::NEG_INFINITY };
                if let Some(before) = last {
                    before.high = slab as f64;
                }
                spans.push(PlannedSpan { low, high: f64::INFINITY, points });
            }
        }
    }
    spans
}
