//! The points in scope that no window has decided yet.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::span::Span;

/// Undecided points, span by span.
#[derive(Debug, Default)]
pub struct Undecided {
    /// Positions in the span, ascending. A span that has been in a window has an entry, whether there are any or not.
    of_span: BTreeMap<u64, Vec<u32>>,
}

impl Undecided {
    /// Takes in a window with the spans `own`, which could not decide those points of theirs, counted on from span to span.
    pub fn take_in(&mut self, own: &[Arc<Span>], mut undecided: &[u32]) {
        let mut first = 0;
        for span in own {
            let end = first + span.len() as u32;
            let (of_span, rest) = undecided.split_at(undecided.partition_point(|point| *point < end));
            let is_among = |position: u32| of_span.binary_search(&(position + first)).is_ok();
            self.of_span
                .entry(span.index)
                .and_modify(|earlier| earlier.retain(|position| is_among(*position)))
                .or_insert_with(|| of_span.iter().map(|point| point - first).collect());
            (first, undecided) = (end, rest);
        }
    }

    /// The undecided points of a window's spans before the span `leaving`, counted on from span to span.
    pub fn before(&self, leaving: u64, own: &[Arc<Span>]) -> Vec<u32> {
        let mut points = Vec::new();
        let mut first = 0;
        for span in own.iter().take_while(|span| span.index < leaving) {
            points.extend(self.of_span.get(&span.index).into_iter().flatten().map(|position| position + first));
            first += span.len() as u32;
        }
        points
    }

    /// Forgets a span; returns how many of its points were never decided.
    pub fn evict(&mut self, span: u64) -> usize {
        self.of_span.remove(&span).map_or(0, |points| points.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::PointIds;

    fn span(index: u64, points: usize) -> Arc<Span> {
        let points = vec![[0.0; 3]; points];
        Arc::new(Span { index, point_ids: PointIds::From(0), points, attributes: vec![], extent: None })
    }

    #[test]
    fn a_point_is_undecided_until_one_window_decides_it() {
        let mut undecided = Undecided::default();
        let first = [span(3, 4), span(4, 0), span(5, 3)];
        undecided.take_in(&first, &[0, 3, 4, 6]);
        assert_eq!((undecided.before(5, &first), undecided.before(6, &first)), (vec![0, 3], vec![0, 3, 4, 6]));
        let second = [span(5, 3), span(6, 2)];
        undecided.take_in(&second, &[0, 1, 4]);
        assert_eq!(undecided.before(u64::MAX, &second), [0, 4]);
        assert_eq!([3, 4, 5, 6, 7].map(|span| undecided.evict(span)), [2, 0, 1, 1, 0]);
        assert_eq!(undecided.before(u64::MAX, &second), [] as [u32; 0]);
    }
}
