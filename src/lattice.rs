//! The lattice that stored coordinates lie on, and the one rule that says whether two points are within a distance.
//!
//! LAS keeps coordinates as integers times a scale plus an offset. Integers are exact in `f64`, also after subtraction
//! and squaring at these sizes, while `integer · scale + offset` at UTM size is not: a pair at exactly the distance
//! would be decided by rounding. So the core computes on lattice coordinates and a pair at exactly the distance is
//! joined, always. Coordinates that come as real numbers may have been such integers once; for them the rounding of
//! the coordinates themselves (half a unit in the last place each) is granted to the pair.

use crate::error::{Error, Result};

/// `real = lattice · scale + offset`, per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    scale: [f64; 3],
    offset: [f64; 3],
    /// Whether lattice coordinates are whole numbers.
    whole: bool,
}

/// Coordinates beyond this are refused: their squares would lose their meaning.
const LARGEST_COORDINATE: f64 = 1e60;

/// Horizontal coordinates nearer to zero than this (2⁻¹⁴²) count as zero.
const SMALLEST_COORDINATE: f64 = 1.793_662_034_335_766e-43;

/// Relative slack on a squared distance. It outweighs the rounding of `d²`, of the scale and of three products (some
/// 1e-15) and stays below one lattice step for distances up to 10⁶ steps.
const SQUARED_SLACK: f64 = 1e-12;

impl Lattice {
    /// Real coordinates, on no lattice that we know of.
    pub const REAL: Lattice = Lattice { scale: [1.0; 3], offset: [0.0; 3], whole: false };

    /// The lattice of whole numbers times `scale` plus `offset`.
    ///
    /// # Errors
    /// If a scale is not a finite number above 0 or an offset is not finite.
    pub fn new(scale: [f64; 3], offset: [f64; 3]) -> Result<Self> {
        for s in scale {
            crate::error::positive("scale", s)?;
        }
        for o in offset {
            if !o.is_finite() {
                return Err(Error::parameter("offset", o, "a finite number"));
            }
        }
        Ok(Self { scale, offset, whole: true })
    }

    /// Real units per lattice step, per axis.
    pub fn scale(&self) -> [f64; 3] {
        self.scale
    }

    /// The real coordinates of the lattice's zero.
    pub fn offset(&self) -> [f64; 3] {
        self.offset
    }

    /// Whether coordinates are whole numbers of steps.
    pub fn is_whole(&self) -> bool {
        self.whole
    }

    /// The real coordinates of a point; bit for bit what LAS readers compute.
    #[inline]
    pub fn real(&self, point: &[f64; 3]) -> [f64; 3] {
        if self.whole { std::array::from_fn(|k| point[k] * self.scale[k] + self.offset[k]) } else { *point }
    }

    /// Where `to` lies from `from`, in real units: on a lattice nothing is lost before the scale comes in.
    #[inline]
    pub(crate) fn offset_between(&self, from: &[f64; 3], to: &[f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| (to[k] - from[k]) * self.scale[k])
    }

    /// Horizontal coordinates in which lengths are true, as near to the lattice as the scales allow. Equal positions
    /// have equal bits, and none is too near to zero for a triangulation.
    #[inline]
    pub(crate) fn horizontal(&self, point: &[f64; 3]) -> [f64; 2] {
        let scale = if self.scale[0] == self.scale[1] { [1.0; 2] } else { [self.scale[0], self.scale[1]] };
        // At such a size only zero is meant, and triangulators refuse it. Adding zero makes 0 of −0.
        let flat = |c: f64| if c.abs() < SMALLEST_COORDINATE { 0.0 } else { c + 0.0 };
        [flat(point[0] * scale[0]), flat(point[1] * scale[1])]
    }

    /// The length of 1 in [horizontal](Self::horizontal) coordinates, in units of the coordinates.
    pub(crate) fn horizontal_unit(&self) -> f64 {
        if self.scale[0] == self.scale[1] { self.scale[0] } else { 1.0 }
    }
}

/// A quotient this near to a whole number was meant to be one: 50 / 0.01 is 5000.
const MEANT_WHOLE: f64 = 1e-9;

/// How many steps a length has, if that was meant to be a whole number.
pub(crate) fn whole_steps(length: f64, step: f64) -> Option<f64> {
    let steps = length / step;
    let whole = steps.round();
    // Half a unit in the last place of a large quotient is not a fraction that was meant.
    let rounding = (steps.abs() * f64::EPSILON).min(0.01);
    ((steps - whole).abs() <= MEANT_WHOLE.max(rounding)).then_some(whole)
}

/// Whether a position can be computed with.
#[inline]
pub fn is_valid(position: &[f64; 3]) -> bool {
    // NaN fails every comparison.
    position.iter().all(|c| c.abs() <= LARGEST_COORDINATE)
}

/// Which coordinates count for a distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Metric {
    /// Length in space.
    #[default]
    Xyz,
    /// Length on the map.
    Xy,
}

/// Decides whether two points lie within a distance of each other.
///
/// It measures in steps of the finest axis, so that squared distances on a lattice are exact whole numbers, wherever
/// the scales are multiples of each other.
#[derive(Debug, Clone, Copy)]
pub struct Within {
    /// Steps of the finest axis per step of each.
    weights: [f64; 3],
    /// The length of a step of the finest axis.
    unit: f64,
    /// Everything from here on is in these steps.
    distance: f64,
    limit: f64,
    rounding: bool,
}

impl Within {
    /// Within `distance` (in real units) under `metric`, for points on `lattice`.
    pub fn new(distance: f64, metric: Metric, lattice: &Lattice) -> Self {
        let counted = if metric == Metric::Xy { &lattice.scale[..2] } else { &lattice.scale[..] };
        let unit = counted.iter().copied().fold(f64::INFINITY, f64::min);
        let mut weights = [0.0; 3];
        for (weight, scale) in weights.iter_mut().zip(counted) {
            *weight = meant(scale / unit);
        }
        let distance = distance / unit;
        Self { weights, unit, distance, limit: distance * distance * (1.0 + SQUARED_SLACK), rounding: !lattice.whole }
    }

    /// Whether the pair is joined; a pair at exactly the distance is.
    #[inline]
    pub fn pair(&self, a: &[f64; 3], b: &[f64; 3]) -> bool {
        self.pair_if(self.squared(a, b), || (*a, *b))
    }

    /// Whether the pair, whose squared distance is known, is joined.
    #[inline]
    pub(crate) fn pair_if(&self, squared: f64, pair: impl FnOnce() -> ([f64; 3], [f64; 3])) -> bool {
        // Beyond twice the distance rounding cannot be what keeps two points apart, unless the coordinates are too
        // coarse for the distance altogether.
        squared <= self.limit
            || (self.rounding && squared <= self.limit() && {
                let (a, b) = pair();
                self.pair_but_for_rounding(&a, &b, squared)
            })
    }

    /// Whether all pairs no further apart than `squared` are joined, also without granting any rounding.
    #[inline]
    pub(crate) fn includes(&self, squared: f64) -> bool {
        squared <= self.limit
    }

    /// No pair with a greater squared distance is joined.
    #[inline]
    pub(crate) fn limit(&self) -> f64 {
        if self.rounding { 4.0 * self.limit } else { self.limit }
    }

    /// Whether no pair at least as far apart as `squared`, of points whose coordinates are no larger than `largest`, is
    /// joined.
    #[inline]
    pub(crate) fn excludes(&self, squared: f64, largest: impl FnOnce() -> ([f64; 3], [f64; 3])) -> bool {
        !self.pair_if(squared, largest)
    }

    /// The squared distance of two points in steps of the finest axis; the same in either direction.
    #[inline]
    pub fn squared(&self, a: &[f64; 3], b: &[f64; 3]) -> f64 {
        let d: [f64; 3] = std::array::from_fn(|k| (a[k] - b[k]) * self.weights[k]);
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    }

    /// Steps of the finest axis per step of each; 0 for an axis that does not count.
    pub(crate) fn weights(&self) -> [f64; 3] {
        self.weights
    }

    /// The length of a squared distance, in real units.
    pub fn length(&self, squared: f64) -> f64 {
        squared.sqrt() * self.unit
    }

    /// The difference of two rounded coordinates is off by at most one unit in the last place of the larger one.
    fn pair_but_for_rounding(&self, a: &[f64; 3], b: &[f64; 3], squared: f64) -> bool {
        let mut off = 0.0;
        for k in 0..3 {
            let unit = unit_in_the_last_place(a[k], b[k]) * self.weights[k];
            off += unit * unit;
        }
        squared.sqrt() - off.sqrt() <= self.distance
    }
}

/// Decides whether a point lies as much above another as allowed; exactly as much will do.
#[derive(Debug, Clone, Copy)]
pub struct Rise {
    low: f64,
    high: f64,
    rounding: bool,
}

impl Rise {
    /// From `low` to `high` (in real units) above, for points on `lattice`.
    pub fn new(low: f64, high: f64, lattice: &Lattice) -> Self {
        let steps = |height: f64| meant(height / lattice.scale[2]);
        Self { low: steps(low), high: steps(high), rounding: !lattice.whole }
    }

    /// Whether a point at the height `to` is as much above one at `from` as allowed.
    #[inline]
    pub fn pair(&self, from: f64, to: f64) -> bool {
        let off = if self.rounding { unit_in_the_last_place(from, to) } else { 0.0 };
        self.low - off <= to - from && to - from <= self.high + off
    }
}

/// Of two rounded numbers, that of the larger one.
#[inline]
fn unit_in_the_last_place(a: f64, b: f64) -> f64 {
    a.abs().max(b.abs()) * f64::EPSILON
}

/// A quotient of two decimal numbers: 0.01 / 0.001 is meant to be 10, and 0.3 / 0.1 to be 3.
fn meant(quotient: f64) -> f64 {
    let whole = quotient.round();
    if (quotient - whole).abs() <= 1e-9 * whole.abs() { whole } else { quotient }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_at_exactly_the_distance_is_joined_on_a_lattice() {
        // 0.6 m at 1 cm: 36² + 48² = 60², though 0.36² + 0.48² > 0.6² in floating point at UTM size.
        let lattice = Lattice::new([0.01; 3], [500_000.0, 5_400_000.0, 0.0]).unwrap();
        let within = Within::new(0.6, Metric::Xyz, &lattice);
        assert!(within.pair(&[0.0, 0.0, 0.0], &[36.0, 48.0, 0.0]));
        assert!(!within.pair(&[0.0, 0.0, 0.0], &[36.0, 48.0, 1.0]));
        assert!(Within::new(0.6, Metric::Xy, &lattice).pair(&[0.0, 0.0, 0.0], &[36.0, 48.0, 1.0]));
    }

    #[test]
    fn real_coordinates_are_granted_their_rounding_and_no_more() {
        let real = |x: i64, y: i64| [x as f64 * 0.01 + 500_000.0, y as f64 * 0.01 + 5_400_000.0, 0.0];
        let within = Within::new(0.6, Metric::Xyz, &Lattice::REAL);
        for i in 0..5_000 {
            let (x, y) = (i * 7919 % 100_003, i * 104_729 % 99_991);
            assert!(within.pair(&real(x, y), &real(x + 36, y + 48)), "point ({x}, {y})");
            assert!(!within.pair(&real(x, y), &real(x + 36, y + 49)), "point ({x}, {y})");
        }
    }

    #[test]
    fn the_scales_of_the_axes_are_counted_in_the_finest() {
        let lattice = Lattice::new([0.01, 0.002, 0.001], [0.0; 3]).unwrap();
        let within = Within::new(0.6, Metric::Xyz, &lattice);
        // 36 · 10, 240 · 2 and 600.
        assert_eq!(within.squared(&[36.0, 240.0, 0.0], &[0.0; 3]), 360_000.0);
        assert!(within.pair(&[36.0, 240.0, 0.0], &[0.0; 3]) && !within.pair(&[36.0, 240.0, 1.0], &[0.0; 3]));
        assert_eq!(within.length(360_000.0), 0.6);
        assert_eq!(Within::new(0.6, Metric::Xy, &lattice).squared(&[1.0, 5.0, 9.0], &[0.0; 3]), 50.0);
    }

    #[test]
    fn a_rise_of_exactly_the_limit_is_allowed() {
        let rise = Rise::new(-0.15, 0.3, &Lattice::new([0.01; 3], [0.0; 3]).unwrap());
        assert!(rise.pair(1000.0, 985.0) && rise.pair(1000.0, 1030.0));
        assert!(!rise.pair(1000.0, 984.0) && !rise.pair(1000.0, 1031.0));
        let real = Rise::new(-0.15, 0.3, &Lattice::REAL);
        let height = |steps: i32| f64::from(steps) * 0.01;
        for z in 0..20_000 {
            assert!(real.pair(height(z), height(z - 15)) && real.pair(height(z), height(z + 30)), "{z}");
            assert!(!real.pair(height(z), height(z - 16)) && !real.pair(height(z), height(z + 31)), "{z}");
        }
    }

    #[test]
    fn invalid_positions_are_told() {
        assert!(is_valid(&[0.0, -5e6, 1e12]));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e61] {
            assert!(!is_valid(&[0.0, bad, 0.0]));
        }
    }
}
