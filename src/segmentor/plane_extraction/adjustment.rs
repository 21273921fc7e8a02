//! The adjustment of a plane that runs along with its points: least squares of the distances across it (Pearson 1901).

use super::Plane;
use crate::features::eigen::{Eigen, Symmetric, eigen};

/// Points whose second axis is shorter than this, squared and relative to the first, lie on a line.
const LINE: f64 = 1e-12;

/// Sums over points, as offsets from an origin near them so that no digits are lost.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    points: f64,
    offsets: [f64; 3],
    products: Symmetric,
}

impl Sums {
    pub(super) fn of(offsets: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut sums = Self::default();
        offsets.for_each(|offset| sums.add(offset));
        sums
    }

    pub(super) fn add(&mut self, offset: [f64; 3]) {
        let [x, y, z] = offset;
        self.points += 1.0;
        for (sum, c) in self.offsets.iter_mut().zip(offset) {
            *sum += c;
        }
        for (sum, product) in self.products.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *sum += product;
        }
    }

    /// The center of gravity.
    pub(super) fn center(&self) -> [f64; 3] {
        self.offsets.map(|sum| sum / self.points)
    }

    fn covariance(&self) -> Symmetric {
        let [x, y, z] = self.center();
        let squared = [x * x, x * y, x * z, y * y, y * z, z * z];
        std::array::from_fn(|k| self.products[k] / self.points - squared[k])
    }

    /// The plane of least squares; none if the points are fewer than three or on a line.
    pub(super) fn adjust(&self) -> Option<Adjusted> {
        if self.points < 3.0 {
            return None;
        }
        let Eigen { values, vectors } = eigen(&self.covariance());
        let squares = values[2].max(0.0) * self.points;
        let sigma0 = if self.points > 3.0 { (squares / (self.points - 3.0)).sqrt() } else { 0.0 };
        let is_plane = values[1] > LINE * values[0];
        is_plane.then_some(Adjusted { center: self.center(), normal: vectors[2], sigma0 })
    }
}

/// A plane, relative to the origin of the sums.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Adjusted {
    /// The center of gravity of the points that it was adjusted to.
    pub(super) center: [f64; 3],
    /// Its unit normal.
    pub(super) normal: [f64; 3],
    /// Standard deviation of a point's distance from it, which takes three of the observations.
    pub(super) sigma0: f64,
}

impl Adjusted {
    /// The same plane in real coordinates, where `origin` is that of the sums that it comes from.
    pub(super) fn plane(&self, origin: [f64; 3], sums: &Sums) -> Plane {
        Plane {
            center: std::array::from_fn(|k| origin[k] + self.center[k]),
            normal: self.normal,
            sigma0: self.sigma0,
            points: sums.points as u64,
            covariance: sums.covariance(),
        }
    }

    pub(super) fn distance(&self, offset: [f64; 3]) -> f64 {
        (0..3).map(|k| (offset[k] - self.center[k]) * self.normal[k]).sum::<f64>().abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plane_of_a_slope_and_its_deviation() {
        let on_slope =
            |x: i32, y: i32, off: f64| [f64::from(x) - 0.6 * off, f64::from(y), 0.75 * f64::from(x) + 0.8 * off];
        // Every place twice, a tenth above and below the slope.
        let places = (0..36).flat_map(|i| [0.1, -0.1].map(|off| on_slope(i / 6, i % 6, off)));
        let plane = Sums::of(places).adjust().unwrap();
        assert!((plane.sigma0 - 0.1 * (72.0f64 / 69.0).sqrt()).abs() < 1e-12);
        assert!((plane.normal[0] / plane.normal[2] + 0.75).abs() < 1e-12 && plane.normal[1].abs() < 1e-12);
        assert!((plane.distance(on_slope(40, -3, 0.3)) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn lines_and_single_places_have_no_plane() {
        assert_eq!(Sums::of(std::iter::empty()).adjust(), None);
        assert_eq!(Sums::of((0..9).map(|i| [0.1 * f64::from(i), 0.3 * f64::from(i), 0.0])).adjust(), None);
        assert_eq!(Sums::of((0..9).map(|_| [0.0; 3])).adjust(), None);
        let three = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
        assert!(Sums::of(three.into_iter()).adjust().unwrap().sigma0 == 0.0);
    }
}
