//! How far away the last of a point's neighbors can be if their mean distance is usual.
//!
//! One stray point far away makes mean and standard deviation, and with them the threshold, as large as it likes, though no
//! point that stays has a neighbor that far. So the greatest distances are kept by mean distance, in steps of a sixteenth
//! of a power of two: a few hundred numbers, the same in any order.

use std::collections::BTreeMap;

/// The greatest distances to the last neighbor, by mean distance.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Farthest(BTreeMap<u64, f64>);

/// What was measured: no point whose mean distance is at most `threshold` has its last neighbor farther away than `length`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// The greatest mean distance for which this holds.
    pub threshold: f64,
    /// The greatest distance to the last neighbor.
    pub length: f64,
}

/// The exponent and the first four digits: numbers of at least 0 keep their order.
fn step(mean: f64) -> u64 {
    mean.to_bits() >> 48
}

impl Farthest {
    /// Notes a point with its mean distance and the distance to its last neighbor.
    pub(super) fn add(&mut self, mean: f64, last: f64) {
        let greatest = self.0.entry(step(mean)).or_default();
        *greatest = greatest.max(last);
    }

    /// Notes all points of `other`.
    pub(super) fn merge(&mut self, other: &Self) {
        for (&step, &last) in &other.0 {
            let greatest = self.0.entry(step).or_default();
            *greatest = greatest.max(last);
        }
    }

    /// How far away the last neighbor is at most if the mean distance is at most `threshold`.
    pub(super) fn up_to(&self, threshold: f64) -> Reach {
        let length = self.0.range(..=step(threshold)).map(|(_, &last)| last).fold(0.0, f64::max);
        Reach { threshold, length }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_above_the_threshold_does_not_count() {
        let mut farthest = Farthest::default();
        for (mean, last) in [(0.0, 0.0), (1.0, 3.0), (1.0, 2.0), (2.0, 2.5), (1e6, 1e7)] {
            farthest.add(mean, last);
        }
        let mut merged = Farthest::default();
        merged.merge(&farthest);
        assert_eq!(merged, farthest);
        let lengths = [0.0, 0.5, 1.0, 2.0, 9e5, 1e6, 1e300].map(|threshold| merged.up_to(threshold).length);
        assert_eq!(lengths, [0.0, 0.0, 3.0, 3.0, 3.0, 1e7, 1e7]);
    }
}
