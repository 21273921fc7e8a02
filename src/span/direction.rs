//! Slabs along a direction, numbered from absolute zero.

use crate::error::{Error, Result};
use crate::lattice::{Lattice, is_valid, whole_steps};

/// The direction along which slabs follow each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Direction {
    /// Along the x axis.
    X,
    /// Along the y axis.
    Y,
    /// Clockwise from north (the y axis), in degrees. Those along an axis, forward or backward, are as exact as [`X`](Self::X)
    /// and [`Y`](Self::Y).
    Azimuth(f64),
}

impl Direction {
    /// The direction of an azimuth in degrees, clockwise from the y axis.
    ///
    /// # Errors
    /// If the azimuth is not finite.
    pub fn azimuth(degrees: f64) -> Result<Self> {
        if degrees.is_finite() {
            Ok(Direction::Azimuth(degrees))
        } else {
            Err(Error::parameter("direction", degrees, "'x', 'y' or an azimuth in degrees, a finite number"))
        }
    }
}

/// The axis and the sign of an azimuth along one.
fn axis_of(degrees: f64) -> Option<(usize, f64)> {
    match degrees.rem_euclid(360.0) {
        0.0 => Some((1, 1.0)),
        90.0 => Some((0, 1.0)),
        180.0 => Some((1, -1.0)),
        270.0 => Some((0, -1.0)),
        _ => None,
    }
}

/// The part of the map, across a direction, all of whose points a span holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Unit vector along which the part is bounded.
    pub direction: [f64; 2],
    /// Lower border; −∞ if the cloud has no point beyond.
    pub low: f64,
    /// Upper border; +∞ if the cloud has no point beyond.
    pub high: f64,
    /// The length of a lattice step along the direction, if the borders lie on whole steps and no rounding can put a
    /// point on the wrong side of one.
    pub step: Option<f64>,
}

impl Extent {
    /// Whether every point of the map within `radius` (in units of the coordinates) of `point` lies inside, whatever
    /// the rounding of the coordinates and of the borders. The lower border is inside, the upper one is not.
    pub(crate) fn holds(&self, point: &[f64; 3], radius: f64, lattice: &Lattice) -> bool {
        let place = lattice.horizontal(point);
        let along = self.direction[0] * place[0] + self.direction[1] * place[1];
        let radius = radius / lattice.horizontal_unit();
        if let Some(step) = self.step {
            let radius = whole_steps(radius, step).unwrap_or(radius / step);
            let steps = |length: f64| (length / step).round();
            return steps(along - self.low) >= radius && self.holds_above(steps(self.high - along), radius);
        }
        let off = rounding(point, lattice) + radius * RADIUS_SLACK;
        along - self.low >= radius + off && self.holds_above(self.high - along, radius + off)
    }

    /// Beyond a border there may be points; where there is none, not even an infinite radius is too large.
    fn holds_above(&self, way: f64, radius: f64) -> bool {
        self.high == f64::INFINITY || way > radius
    }

    /// How far `point` is from the nearest border, in units of the coordinates and whatever the rounding: 0 if it lies
    /// beyond, ∞ if there is no border.
    pub(crate) fn distance_to_border(&self, point: &[f64; 3], lattice: &Lattice) -> f64 {
        let place = lattice.horizontal(point);
        let along = self.direction[0] * place[0] + self.direction[1] * place[1];
        let way = (along - self.low).min(self.high - along) - rounding(point, lattice);
        (way * lattice.horizontal_unit()).max(0.0)
    }

    /// The part whose points have everything within `margin` (in units of the coordinates) inside.
    pub(crate) fn shrunk(self, margin: f64, lattice: &Lattice) -> Self {
        let margin = margin / lattice.horizontal_unit();
        let [low, high] = match self.step {
            // Points lie on whole steps, and the borders have to stay there too.
            Some(step) => match whole_steps(margin, step) {
                Some(steps) => [steps * step; 2],
                None => [(margin / step).ceil() * step, (margin / step).floor() * step],
            },
            None => [margin * (1.0 + RADIUS_SLACK); 2],
        };
        Self { low: self.low + low, high: self.high - high, ..self }
    }
}

/// More than the rounding of a coordinate, of a border and of which slab a point was put into add up to.
fn rounding(point: &[f64; 3], lattice: &Lattice) -> f64 {
    let (real, offset) = (lattice.real(point), lattice.offset());
    let largest: f64 = (0..3).map(|k| real[k].abs() + offset[k].abs()).sum();
    16.0 * f64::EPSILON * largest / lattice.horizontal_unit()
}

/// More than the relative slack on a distance, see [`crate::lattice::Within`].
const RADIUS_SLACK: f64 = 1e-11;

/// Tells the slab of a point: `floor(way / width)`, where `way` is the real coordinate along the direction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlabIndex {
    weights: [f64; 2],
    zero: f64,
    width: f64,
    /// Whether the way, the zero and the width are whole numbers of lattice steps, so that no rounding can lift a
    /// point over the border of its slab.
    whole: bool,
}

/// Slab numbers beyond this would not be exact.
const MOST_SLABS: f64 = 9e15;

impl SlabIndex {
    pub(crate) fn new(width: f64, direction: Direction, lattice: &Lattice) -> Self {
        let (axis, sign) = match direction {
            Direction::X => (0, 1.0),
            Direction::Y => (1, 1.0),
            Direction::Azimuth(degrees) => match axis_of(degrees) {
                Some(along) => along,
                None => return Self::oblique(width, degrees, lattice),
            },
        };
        let (scale, offset) = (lattice.scale()[axis], lattice.offset()[axis]);
        let mut weights = [0.0; 2];
        if let (true, Some(width), Some(offset)) =
            (lattice.is_whole(), whole_steps(width, scale), whole_steps(offset, scale))
        {
            weights[axis] = sign;
            return Self { weights, zero: -sign * offset, width, whole: true };
        }
        weights[axis] = sign * scale;
        Self { weights, zero: -sign * offset, width, whole: false }
    }

    fn oblique(width: f64, degrees: f64, lattice: &Lattice) -> Self {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (scale, offset) = (lattice.scale(), lattice.offset());
        Self {
            weights: [sin * scale[0], cos * scale[1]],
            zero: -(sin * offset[0] + cos * offset[1]),
            width,
            whole: false,
        }
    }

    /// The slab of a point; of an invalid point, none.
    #[inline]
    pub(crate) fn of(&self, point: &[f64; 3]) -> Result<Option<i64>> {
        let way = point[0] * self.weights[0] + point[1] * self.weights[1] - self.zero;
        let slab = (way / self.width).floor();
        if slab.abs() < MOST_SLABS {
            return Ok(Some(slab as i64));
        }
        if is_valid(point) { Err(self.too_narrow(slab)) } else { Ok(None) }
    }

    #[cold]
    fn too_narrow(&self, slab: f64) -> Error {
        let width = if self.whole { format!("{} lattice steps", self.width) } else { self.width.to_string() };
        Error::InvalidParameter {
            name: "width",
            given: format!("{width}, which puts a point {slab:e} slabs from zero"),
            allowed: "a width that leaves fewer than 9e15",
        }
    }

    /// The extent of the slabs from `first` up to, but without, `end`; no bound where there is none.
    pub(crate) fn extent(&self, first: Option<i64>, end: Option<i64>, lattice: &Lattice) -> Extent {
        // Weights are per lattice coordinate; the map on which neighbors are found may be scaled.
        let per_unit = lattice.horizontal(&[1.0, 1.0, 0.0]);
        let gradient = [self.weights[0] / per_unit[0], self.weights[1] / per_unit[1]];
        let length = gradient[0].hypot(gradient[1]);
        let border = |slab: i64| (slab as f64 * self.width + self.zero) / length;
        Extent {
            direction: gradient.map(|g| g / length),
            low: first.map_or(f64::NEG_INFINITY, border),
            high: end.map_or(f64::INFINITY, border),
            step: self.whole.then(|| length.recip()),
        }
    }

    /// Whether two points at exactly `slabs` widths of each other are sure to be no further apart than `slabs` slabs.
    pub(crate) fn is_exact(&self) -> bool {
        self.whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_are_half_open_and_anchored_at_absolute_zero() {
        let lattice = Lattice::new([0.01; 3], [500_000.0, 0.0, 0.0]).unwrap();
        let slab = SlabIndex::new(0.3, Direction::X, &lattice);
        assert!(slab.is_exact());
        for x in -100i64..100 {
            // 500 000 m are 50 000 000 steps.
            assert_eq!(slab.of(&[x as f64, 0.0, 0.0]).unwrap(), Some((50_000_000 + x).div_euclid(30)));
        }
    }

    #[test]
    fn azimuths_run_clockwise_from_the_y_axis() {
        let slab = |degrees| SlabIndex::new(10.0, Direction::Azimuth(degrees), &Lattice::REAL);
        assert_eq!(slab(90.0).of(&[25.0, -70.0, 0.0]).unwrap(), Some(2));
        assert_eq!(slab(0.0).of(&[25.0, -75.0, 0.0]).unwrap(), Some(-8));
        assert_eq!(slab(45.0).of(&[10.0, 10.0, 0.0]).unwrap(), Some(1));
    }

    #[test]
    fn backward_along_an_axis_is_as_exact_as_forward() {
        let lattice = Lattice::new([0.01; 3], [500_000.0, -3.0, 0.0]).unwrap();
        for (degrees, axis, sign) in [(90.0, 0, 1), (270.0, 0, -1), (-90.0, 0, -1), (0.0, 1, 1), (180.0, 1, -1)] {
            let slab = SlabIndex::new(0.3, Direction::Azimuth(degrees), &lattice);
            assert!(slab.is_exact());
            for steps in -100i64..100 {
                let mut point = [0.0; 3];
                point[axis] = steps as f64;
                let way = sign * (steps + [50_000_000, -300][axis]);
                assert_eq!(slab.of(&point).unwrap(), Some(way.div_euclid(30)), "{degrees} {steps}");
                let extent = slab.extent(Some(way.div_euclid(30)), Some(way.div_euclid(30) + 1), &lattice);
                let off = way.rem_euclid(30);
                for radius in 0..31 {
                    let holds = radius <= off && radius < 30 - off;
                    assert_eq!(
                        extent.holds(&point, radius as f64 * 0.01, &lattice),
                        holds,
                        "{degrees} {steps} {radius}"
                    );
                }
            }
        }
    }

    #[test]
    fn an_extent_holds_a_disc_that_ends_on_its_lower_border_but_none_that_ends_on_its_upper() {
        for (scale, offset) in [([0.01; 3], 500_000.0), ([0.01, 0.002, 0.001], 500_000.0), ([0.001, 0.1, 1.0], -0.5)] {
            let lattice = Lattice::new(scale, [offset, 0.0, 0.0]).unwrap();
            let slab = SlabIndex::new(0.3, Direction::X, &lattice);
            assert!(slab.is_exact());
            let steps = (0.3 / scale[0]).round();
            let first = slab.of(&[0.0; 3]).unwrap().unwrap();
            let extent = slab.extent(Some(first - 1), Some(first + 2), &lattice);
            // Where the slab in the middle begins.
            let begin = (first as f64 * 0.3 / scale[0]).round() - (offset / scale[0]).round();
            for x in 0..steps as i64 {
                assert!(extent.holds(&[begin + x as f64, 7.0, 3.0], 0.3, &lattice), "{scale:?} {x}");
            }
            assert!(!extent.holds(&[begin - 1.0, 7.0, 3.0], 0.3, &lattice));
            assert!(!extent.holds(&[begin + steps, 7.0, 3.0], 0.3, &lattice));
            assert!(slab.extent(None, None, &lattice).holds(&[begin, 7.0, 3.0], f64::INFINITY, &lattice));
            // Within a step of 0.104: the border of what holds a disc is the first whole step inside.
            let smaller = extent.shrunk(0.104, &lattice);
            for x in -steps as i64..2 * steps as i64 {
                let at = [begin + x as f64, 0.0, 0.0];
                assert_eq!(smaller.holds(&at, 0.0, &lattice), extent.holds(&at, 0.104, &lattice), "{scale:?} {x}");
            }
        }
    }

    #[test]
    fn where_coordinates_are_rounded_an_extent_keeps_away_from_its_borders() {
        let slab = SlabIndex::new(1.0, Direction::Azimuth(90.0), &Lattice::REAL);
        let extent = slab.extent(Some(5_000_000), Some(5_000_003), &Lattice::REAL);
        let holds = |x: f64| extent.holds(&[x, 4e5, 100.0], 1.0, &Lattice::REAL);
        assert!(holds(5_000_001.000_001) && holds(5_000_001.999_999));
        assert!(!holds(5_000_001.0) && !holds(5_000_002.0));
        assert!(slab.extent(None, None, &Lattice::REAL).holds(&[0.0; 3], f64::INFINITY, &Lattice::REAL));
    }

    #[test]
    fn an_invalid_point_lies_in_no_slab() {
        let slab = SlabIndex::new(1.0, Direction::X, &Lattice::REAL);
        assert_eq!(slab.of(&[f64::NAN, 0.0, 0.0]).unwrap(), None);
        assert_eq!(slab.of(&[f64::INFINITY, 0.0, 0.0]).unwrap(), None);
        assert!(slab.of(&[1e60, 0.0, 0.0]).unwrap_err().to_string().starts_with("width is 1, which puts a point 1e60"));
    }
}
