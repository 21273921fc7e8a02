//! Labels, which mean something inside one window, and segment ids, which mean the same along the whole stream.

mod cause;

use std::collections::HashMap;

pub use cause::{ByCause, Cause};

/// A number that means the same along the whole stream: from 1 upward in window order, never reused.
pub type SegmentId = i64;

/// No segment, no successor, no label.
pub const NONE: i64 = -1;

/// One label per point of a window, in the canonical numbering: 0, 1, 2 … in the order in which a label first occurs.
///
/// Canonical labels depend on the partition and on the order of the points only, so they are the same for any number
/// of threads and any way in which a segmentor came to its partition. Where a point has none, its [`Cause`] stands in
/// the label's place; [`NONE`] as long as no other is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Labels {
    of_point: Vec<i32>,
    count: u32,
}

impl Labels {
    /// Labels that are numbered in any way; [`NONE`] stays none.
    pub fn from_any(labels: &[i64]) -> Self {
        let mut canonical = Renumbering::default();
        let of_point = labels.iter().map(|&label| canonical.number(label)).collect();
        Self { of_point, count: canonical.count() }
    }

    /// Labels from the representative of each point, a number below `representatives`.
    pub fn from_representatives(of_point: impl ExactSizeIterator<Item = u32>, representatives: usize) -> Self {
        let mut number = vec![NONE as i32; representatives];
        let mut count = 0;
        let of_point = of_point
            .map(|representative| {
                let label = &mut number[representative as usize];
                if *label == NONE as i32 {
                    *label = count;
                    count += 1;
                }
                *label
            })
            .collect();
        Self { of_point, count: count as u32 }
    }

    /// The label of each point; below 0 = none, and why.
    pub fn of_points(&self) -> &[i32] {
        &self.of_point
    }

    /// How many different labels there are.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// The same with a cause for those of `points` that have no label, whatever the cause has been.
    pub fn because(&mut self, points: impl IntoIterator<Item = u32>, cause: Cause) {
        for point in points {
            let label = &mut self.of_point[point as usize];
            if *label < 0 {
                *label = cause.label();
            }
        }
    }

    /// The same with a cause for all points that have no label and no other cause.
    pub fn otherwise(&mut self, cause: Cause) {
        if cause != Cause::BySegmentor {
            self.of_point.iter_mut().filter(|label| **label == NONE as i32).for_each(|label| *label = cause.label());
        }
    }

    /// The labels of the points at `positions`, `lacking` where there is no position; and for each of these labels which
    /// one it was.
    pub fn take(&self, positions: impl Iterator<Item = Option<u32>>, lacking: Cause) -> (Self, Vec<u32>) {
        let mut number = vec![NONE as i32; self.count()];
        let mut old = Vec::new();
        let of_point = positions
            .map(|position| {
                let label = position.map_or(lacking.label(), |position| self.of_point[position as usize]);
                if label < 0 {
                    return label;
                }
                let number = &mut number[label as usize];
                if *number == NONE as i32 {
                    *number = old.len() as i32;
                    old.push(label as u32);
                }
                *number
            })
            .collect();
        (Self { of_point, count: old.len() as u32 }, old)
    }

    /// Spreads the labels of some of `points` points over all of them: the `others` get none.
    pub(crate) fn spread(self, over: &[u32], points: usize, others: Cause) -> Self {
        let mut of_point = vec![others.label(); points];
        for (&position, label) in over.iter().zip(self.of_point) {
            of_point[position as usize] = label;
        }
        Self { of_point, count: self.count }
    }
}

/// Numbers arbitrary labels in the order in which they first occur.
#[derive(Default)]
struct Renumbering {
    number: HashMap<i64, i32>,
    last: Option<(i64, i32)>,
}

impl Renumbering {
    fn number(&mut self, label: i64) -> i32 {
        if label == NONE {
            return NONE as i32;
        }
        // Neighbours in a span mostly carry the same label.
        if let Some((last, number)) = self.last
            && last == label
        {
            return number;
        }
        let next = self.number.len() as i32;
        let number = *self.number.entry(label).or_insert(next);
        self.last = Some((label, number));
        number
    }

    fn count(&self) -> u32 {
        self.number.len() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_numbered_by_first_occurrence() {
        let labels = Labels::from_any(&[70, -1, 3, 70, 9, 3]);
        assert_eq!(labels.of_points(), [0, -1, 1, 0, 2, 1]);
        assert_eq!(labels.count(), 3);
        let same = Labels::from_representatives([4, 2, 4, 0].into_iter(), 5);
        assert_eq!(same.of_points(), [0, 1, 0, 2]);
    }

    #[test]
    fn some_of_the_labels_are_numbered_anew() {
        let labels = Labels::from_any(&[5, 6, 7, 6, -1]);
        let (some, old) = labels.take([Some(3), None, Some(2), Some(1), Some(4)].into_iter(), Cause::Removed);
        assert_eq!(some.of_points(), [0, Cause::Removed.label(), 1, 0, -1]);
        assert_eq!((some.count(), old), (2, vec![1, 2]));
    }

    #[test]
    fn points_left_out_get_no_label() {
        let filtered = Cause::Filtered.label();
        let labels = Labels::from_any(&[5, 6]).spread(&[1, 3], 4, Cause::Filtered);
        assert_eq!(labels.of_points(), [filtered, 0, filtered, 1]);
        assert_eq!(labels.count(), 2);
    }

    #[test]
    fn a_cause_is_said_of_points_without_a_label_only() {
        let mut labels = Labels::from_any(&[5, -1, -1, -1]).spread(&[0, 1, 2, 4], 5, Cause::Filtered);
        labels.because([0, 1, 3], Cause::Undecided);
        labels.otherwise(Cause::Noise);
        let [undecided, noise] = [Cause::Undecided, Cause::Noise].map(Cause::label);
        assert_eq!(labels.of_points(), [0, undecided, noise, undecided, noise]);
    }
}
