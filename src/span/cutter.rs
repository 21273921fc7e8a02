//! Cuts a stream into spans in the order in which its points come.

use super::{Chunk, Extent, PointIds, SlabIndex, Span, SpanBy, SpanSource};
use crate::error::{Error, Result};
use crate::lattice::Lattice;

/// Cuts chunks into spans by count, time, scan line, slab of a sorted source, or as given.
pub struct Cutter<C> {
    /// The source until it is stopped.
    chunks: Option<C>,
    rule: Rule,
    lattice: Lattice,
    chunk: Chunk,
    /// How much of the chunk has been taken.
    taken: usize,
    /// Points of the span under way, and their attributes.
    open: Chunk,
    first_id: i64,
    index: u64,
    ended: bool,
    /// Why the source ended early; it is told when all points that came before it have gone out.
    failure: Option<Error>,
}

impl<C: Iterator<Item = Result<Chunk>>> Cutter<C> {
    /// Cuts `chunks` according to `by`, which has to be valid.
    pub fn new(chunks: C, by: SpanBy, lattice: &Lattice) -> Self {
        Self {
            chunks: Some(chunks),
            rule: Rule::new(by, lattice),
            lattice: *lattice,
            chunk: Chunk::default(),
            taken: 0,
            open: Chunk::default(),
            first_id: 0,
            index: 0,
            ended: false,
            failure: None,
        }
    }

    fn close_span(&mut self) -> Span {
        let Chunk { points, attributes } = std::mem::take(&mut self.open);
        let extent = self.rule.close_extent(self.index == 0, self.ended, &self.lattice);
        let point_ids = PointIds::From(self.first_id);
        let span = Span { index: self.index, point_ids, points, attributes, extent };
        self.index += 1;
        self.first_id += span.len() as i64;
        span
    }

    /// Takes points of the chunk up to the end of the span under way; whether that end was reached.
    fn take_points(&mut self) -> Result<bool> {
        let start = self.taken;
        let mut ends = Ok(false);
        while self.taken < self.chunk.points.len() {
            let point_id = self.first_id + (self.open.points.len() + self.taken - start) as i64;
            ends = self.rule.starts_span(&self.chunk, self.taken, point_id);
            if !matches!(ends, Ok(false)) {
                break;
            }
            self.taken += 1;
        }
        self.open.append(&self.chunk, start..self.taken);
        ends
    }

    fn end(&mut self, failure: Option<Error>) {
        self.ended = true;
        self.failure = failure;
    }
}

impl<C: Iterator<Item = Result<Chunk>>> Iterator for Cutter<C> {
    type Item = Result<Span>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            match self.take_points() {
                Ok(true) => return Some(Ok(self.close_span())),
                Ok(false) => {}
                Err(error) => {
                    self.end(Some(error));
                    break;
                }
            }
            match self.chunks.as_mut().and_then(Iterator::next) {
                Some(Ok(chunk)) => {
                    (self.chunk, self.taken) = (chunk, 0);
                    if matches!(self.rule, Rule::Given) {
                        self.open = std::mem::take(&mut self.chunk);
                        return Some(Ok(self.close_span()));
                    }
                }
                Some(Err(error)) => self.end(Some(error)),
                None => self.end(None),
            }
        }
        if self.open.points.is_empty() { self.failure.take().map(Err) } else { Some(Ok(self.close_span())) }
    }
}

impl<C: Iterator<Item = Result<Chunk>> + Send> SpanSource for Cutter<C> {
    fn stop(&mut self) {
        self.chunks = None;
    }
}

/// Where a new span starts, and what has to be remembered of the span under way to know it.
enum Rule {
    Width { slab: SlabIndex, first: i64, current: Option<i64> },
    Count { points: usize, taken: usize },
    Time { seconds: f64, first: Option<f64> },
    ScanLine { lines: usize, ended: usize, last: Option<[bool; 2]> },
    Given,
}

impl Rule {
    fn new(by: SpanBy, lattice: &Lattice) -> Self {
        match by {
            SpanBy::Width { width, direction } | SpanBy::Slabs { width, direction, .. } => {
                Rule::Width { slab: SlabIndex::new(width, direction, lattice), first: 0, current: None }
            }
            SpanBy::Count { points } => Rule::Count { points, taken: 0 },
            SpanBy::Time { seconds } => Rule::Time { seconds, first: None },
            SpanBy::ScanLine { lines } => Rule::ScanLine { lines, ended: 0, last: None },
            SpanBy::Given => Rule::Given,
        }
    }

    /// The extent of the span that ends here, if it is one of space: up to the slab of the point that ended it.
    fn close_extent(&mut self, is_first: bool, is_last: bool, lattice: &Lattice) -> Option<Extent> {
        let Rule::Width { slab, first, current } = self else { return None };
        let end = if is_last { None } else { *current };
        let extent = slab.extent((!is_first).then_some(*first), end, lattice);
        *first = current.unwrap_or(*first);
        Some(extent)
    }

    /// Whether the point at `position` is the first of a new span. It is asked once for a point that goes on with the
    /// span, twice for one that starts a new span.
    fn starts_span(&mut self, chunk: &Chunk, position: usize, point_id: i64) -> Result<bool> {
        match self {
            Rule::Given => Ok(false),
            Rule::Count { points, taken } => {
                if taken == points {
                    *taken = 0;
                    return Ok(true);
                }
                *taken += 1;
                Ok(false)
            }
            Rule::Time { seconds, first } => {
                let time = chunk.attributes[0][position];
                if !time.is_finite() {
                    return Err(Error::Attribute { name: "gps_time", point_id, value: time });
                }
                match *first {
                    // A flight line may be older than the one before it, so time may also jump back.
                    Some(start) if (time - start).abs() >= *seconds => {
                        *first = None;
                        Ok(true)
                    }
                    Some(_) => Ok(false),
                    None => {
                        *first = Some(time);
                        Ok(false)
                    }
                }
            }
            Rule::ScanLine { lines, ended, last } => {
                let flags = [chunk.attributes[0][position] != 0.0, chunk.attributes[1][position] != 0.0];
                if let Some([direction, edge]) = last.replace(flags)
                    && (direction != flags[0] || (edge && !flags[1]))
                {
                    *ended += 1;
                    if *ended == *lines {
                        *ended = 0;
                        return Ok(true);
                    }
                }
                Ok(false)
            }
            Rule::Width { slab, current, .. } => {
                // A point with no valid position stays with the points it came with.
                let Some(to) = slab.of(&chunk.points[position])? else { return Ok(false) };
                match *current {
                    Some(from) if to < from => Err(Error::NotSorted { point_id, from, to }),
                    Some(from) if to > from => {
                        *current = Some(to);
                        Ok(true)
                    }
                    _ => {
                        *current = Some(to);
                        Ok(false)
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::Direction;

    fn chunk(xs: &[f64], attributes: &[&[f64]]) -> Chunk {
        Chunk {
            points: xs.iter().map(|&x| [x, 0.0, 0.0]).collect(),
            attributes: attributes.iter().map(|a| a.to_vec()).collect(),
        }
    }

    fn cut(chunks: Vec<Chunk>, by: SpanBy) -> Vec<Vec<f64>> {
        let mut next_id = 0;
        Cutter::new(chunks.into_iter().map(Ok), by, &Lattice::REAL)
            .enumerate()
            .map(|(i, span)| {
                let span = span.unwrap();
                assert_eq!(span.index, i as u64);
                assert_eq!(span.point_ids, PointIds::From(next_id));
                next_id += span.len() as i64;
                span.points.iter().map(|p| p[0]).collect()
            })
            .collect()
    }

    /// The same stream in chunks of every size.
    fn in_chunks(xs: &[f64], attributes: &[&[f64]], size: usize) -> Vec<Chunk> {
        (0..xs.len())
            .step_by(size)
            .map(|i| {
                let end = (i + size).min(xs.len());
                chunk(&xs[i..end], &attributes.iter().map(|a| &a[i..end]).collect::<Vec<_>>())
            })
            .collect()
    }

    fn cut_in_any_chunks(xs: &[f64], attributes: &[&[f64]], by: SpanBy) -> Vec<Vec<f64>> {
        let whole = cut(in_chunks(xs, attributes, xs.len()), by);
        for size in 1..xs.len() {
            assert_eq!(cut(in_chunks(xs, attributes, size), by), whole, "chunks of {size}");
        }
        whole
    }

    #[test]
    fn by_count() {
        let xs = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let spans = cut_in_any_chunks(&xs, &[], SpanBy::Count { points: 3 });
        assert_eq!(spans, [vec![0.0, 1.0, 2.0], vec![3.0, 4.0, 5.0], vec![6.0]]);
    }

    #[test]
    fn by_time_also_when_time_jumps_back() {
        let xs = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let time: &[f64] = &[10.0, 10.4, 11.0, 11.5, 5.0, 5.9];
        let spans = cut_in_any_chunks(&xs, &[time], SpanBy::Time { seconds: 1.0 });
        assert_eq!(spans, [vec![0.0, 1.0], vec![2.0, 3.0], vec![4.0, 5.0]]);
    }

    #[test]
    fn by_scan_line_at_turns_of_the_mirror_and_behind_edges() {
        let xs = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let direction: &[f64] = &[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        let edge: &[f64] = &[0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0];
        let spans = cut_in_any_chunks(&xs, &[direction, edge], SpanBy::ScanLine { lines: 1 });
        assert_eq!(spans, [vec![0.0, 1.0], vec![2.0, 3.0], vec![4.0, 5.0, 6.0], vec![7.0]]);
        let spans = cut_in_any_chunks(&xs, &[direction, edge], SpanBy::ScanLine { lines: 2 });
        assert_eq!(spans, [vec![0.0, 1.0, 2.0, 3.0], vec![4.0, 5.0, 6.0, 7.0]]);
    }

    #[test]
    fn by_width_while_sorted_and_an_error_where_not() {
        let by = SpanBy::Width { width: 2.0, direction: Direction::X };
        let xs = [-0.5, 0.0, 1.9, f64::NAN, 2.0, 9.0];
        let spans = cut(in_chunks(&xs, &[], 4), by);
        assert_eq!(spans.iter().map(Vec::len).collect::<Vec<_>>(), [1, 3, 1, 1]);
        let cutter = Cutter::new(in_chunks(&xs, &[], 4).into_iter().map(Ok), by, &Lattice::REAL);
        let borders: Vec<_> = cutter.map(|span| span.unwrap().extent.map(|e| (e.low, e.high)).unwrap()).collect();
        let (least, most) = (f64::NEG_INFINITY, f64::INFINITY);
        assert_eq!(borders, [(least, 0.0), (0.0, 2.0), (2.0, 8.0), (8.0, most)]);

        let mut cutter = Cutter::new([Ok(chunk(&[0.0, 5.0, 1.0], &[]))].into_iter(), by, &Lattice::REAL);
        assert_eq!(cutter.next().unwrap().unwrap().len(), 1);
        assert_eq!(cutter.next().unwrap().unwrap().len(), 1);
        let error = cutter.next().unwrap().unwrap_err();
        assert!(matches!(error, Error::NotSorted { point_id: 2, from: 2, to: 0 }), "{error}");
        assert!(cutter.next().is_none());
    }

    #[test]
    fn a_failing_source_costs_no_point() {
        let failing = [Ok(chunk(&[0.0, 1.0, 2.0], &[])), Err(Error::parameter("test", 0, "nothing"))];
        let mut cutter = Cutter::new(failing.into_iter(), SpanBy::Count { points: 2 }, &Lattice::REAL);
        assert_eq!(cutter.next().unwrap().unwrap().len(), 2);
        assert_eq!(cutter.next().unwrap().unwrap().len(), 1);
        assert!(cutter.next().unwrap().is_err());
        assert!(cutter.next().is_none());
    }

    #[test]
    fn given_spans_stay_as_they_are_even_empty_ones() {
        let spans = cut(vec![chunk(&[1.0], &[]), chunk(&[], &[]), chunk(&[2.0, 3.0], &[])], SpanBy::Given);
        assert_eq!(spans, [vec![1.0], vec![], vec![2.0, 3.0]]);
    }
}
