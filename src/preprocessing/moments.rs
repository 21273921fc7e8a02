//! Mean and standard deviation of very many numbers, whatever the order in which they come.
//!
//! The numbers and their squares are summed without any rounding: every power of two has a whole number of its own. So the
//! sums, and all that follows from them, are the same in any order and on any number of threads. Only the last step rounds;
//! it computes with twice the digits of a number, so that nothing cancels out.

use std::collections::BTreeMap;

use super::farthest::Reach;

/// Numbers that are at least 0, summed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Moments {
    count: u64,
    positive: u64,
    sum: ExactSum,
    squares: ExactSum,
}

/// Mean and standard deviation of `count` numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// How many numbers there are.
    pub count: u64,
    /// Their mean; 0 of no number.
    pub mean: f64,
    /// Their standard deviation, with n − 1 in the denominator; 0 of fewer than two numbers.
    pub deviation: f64,
    /// How far away neighbors are, where that was measured too.
    pub reach: Option<Reach>,
}

impl Moments {
    /// Adds a finite number that is at least 0.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        if value > 0.0 {
            let (digits, exponent) = parts(value);
            let square = u128::from(digits) * u128::from(digits);
            self.positive += 1;
            self.sum.add(u128::from(digits), exponent);
            // Two halves, so that many of them can be summed.
            self.squares.add(square & LOW_HALF, 2 * exponent);
            self.squares.add(square >> HALF, 2 * exponent + HALF as i32);
        }
    }

    /// Adds all that were added to `other`.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.positive += other.positive;
        self.sum.merge(&other.sum);
        self.squares.merge(&other.squares);
    }

    /// Mean and standard deviation of all numbers.
    pub fn statistics(&self) -> Statistics {
        self.with_deviations_of(self.count)
    }

    /// The same, but zeros count in the mean only: what they deviate from it is left out.
    pub fn statistics_without_deviations_of_zeros(&self) -> Statistics {
        self.with_deviations_of(self.positive)
    }

    /// Σ(d − μ)² over `deviating` of n numbers is Σd² − (Σd)² · (2n − deviating) / n², if the others are 0.
    fn with_deviations_of(&self, deviating: u64) -> Statistics {
        if self.count == 0 {
            return Statistics { count: 0, mean: 0.0, deviation: 0.0, reach: None };
        }
        let (n, sum, squares) = (self.count as f64, self.sum.value(), self.squares.value());
        let mean = sum.over(n);
        let part = sum.times(sum).times(Double::from(2.0 * n - deviating as f64)).over(n).over(n);
        let squared = squares.plus(part.negative()).high.max(0.0);
        let deviation = if self.count < 2 { 0.0 } else { (squared / (n - 1.0)).sqrt() };
        Statistics { count: self.count, mean: mean.high, deviation, reach: None }
    }
}

/// Half of the digits of a square.
const HALF: u32 = 53;
const LOW_HALF: u128 = (1 << HALF) - 1;

/// `digits · 2^exponent` of a number above 0.
fn parts(value: f64) -> (u64, i32) {
    let bits = value.to_bits();
    let (fraction, exponent) = (bits & ((1 << 52) - 1), (bits >> 52) as i32);
    // Numbers next to zero have no leading one.
    if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent - 1075) }
}

/// A sum without rounding: for each exponent, how many times two to its power.
#[derive(Debug, Clone, Default, PartialEq)]
struct ExactSum(BTreeMap<i32, u128>);

impl ExactSum {
    fn add(&mut self, digits: u128, exponent: i32) {
        *self.0.entry(exponent).or_default() += digits;
    }

    fn merge(&mut self, other: &Self) {
        for (&exponent, &digits) in &other.0 {
            self.add(digits, exponent);
        }
    }

    fn value(&self) -> Double {
        self.0.iter().fold(Double::from(0.0), |sum, (&exponent, &digits)| {
            let high = digits as f64;
            // What was rounded away or up; it is small.
            let low = (digits.wrapping_sub(high as u128) as i128) as f64;
            let unit = 2f64.powi(exponent);
            sum.plus(Double { high: high * unit, low: low * unit })
        })
    }
}

/// A number with twice the digits (Dekker, 1971).
#[derive(Clone, Copy)]
struct Double {
    high: f64,
    low: f64,
}

impl From<f64> for Double {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Double {
    /// `high + low`, of which the second may be the larger one.
    fn of_sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let rest = high - a;
        Self { high, low: (a - (high - rest)) + (b - rest) }
    }

    fn plus(self, other: Self) -> Self {
        let Self { high, low } = Self::of_sum(self.high, other.high);
        Self::of_sum(high, low + self.low + other.low)
    }

    fn negative(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }

    fn times(self, other: Self) -> Self {
        let high = self.high * other.high;
        let low = self.high.mul_add(other.high, -high);
        Self::of_sum(high, low + self.high * other.low + self.low * other.high)
    }

    fn over(self, divisor: f64) -> Self {
        let high = self.high / divisor;
        let rest = (-high).mul_add(divisor, self.high) + self.low;
        Self::of_sum(high, rest / divisor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(values: &[f64]) -> Moments {
        let mut moments = Moments::default();
        for &value in values {
            moments.add(value);
        }
        moments
    }

    proptest! {
        #[test]
        fn the_order_changes_nothing(
            mut values in prop::collection::vec(prop_oneof![Just(0.0), 1e-9..1e9f64, 0.1..0.2f64], 0..100),
            split in 0usize..100,
        ) {
            let whole = of(&values);
            let mut halves = of(&values[split.min(values.len())..]);
            halves.merge(&of(&values[..split.min(values.len())]));
            prop_assert_eq!(&whole, &halves);
            values.sort_by(f64::total_cmp);
            prop_assert_eq!(whole.statistics(), of(&values).statistics());
        }

        #[test]
        fn mean_and_deviation_are_those_of_two_passes(
            values in prop::collection::vec(prop_oneof![Just(0.0), 5.0..5.5f64], 2..100),
        ) {
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let squared = |values: &mut dyn Iterator<Item = &f64>| values.map(|v| (v - mean) * (v - mean)).sum::<f64>();
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-13 * mean;
            let all = of(&values).statistics();
            prop_assert!(near(all.mean, mean) && near(all.deviation, (squared(&mut values.iter()) / (n - 1.0)).sqrt()));
            let positive = of(&values).statistics_without_deviations_of_zeros();
            let expected = squared(&mut values.iter().filter(|v| **v > 0.0)) / (n - 1.0);
            prop_assert!(near(positive.deviation, expected.sqrt()));
        }
    }

    #[test]
    fn equal_numbers_do_not_deviate() {
        for value in [0.1, 1.0 / 3.0, 1e-12, 7e8] {
            let all = of(&[value; 1000]).statistics();
            assert_eq!(all.mean, value);
            assert!(all.deviation <= 1e-15 * value, "{all:?}");
        }
        assert_eq!(of(&[]).statistics(), Statistics { count: 0, mean: 0.0, deviation: 0.0, reach: None });
        assert_eq!(of(&[3.0]).statistics(), Statistics { count: 1, mean: 3.0, deviation: 0.0, reach: None });
    }

    #[test]
    fn nothing_cancels_out() {
        // Deviations of a billionth of the mean.
        let values: Vec<f64> = (0..1000).map(|i| 1.0 + f64::from(i % 2) * 1e-9).collect();
        let deviation = of(&values).statistics().deviation;
        assert!((deviation / (0.5e-9 * (1000.0f64 / 999.0).sqrt()) - 1.0).abs() < 1e-6, "{deviation}");
    }
}
