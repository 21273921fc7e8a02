//! The plane through a point's neighbors, by least squares of the distances across it (Pearson 1901).
//!
//! Neighbors are given as offsets from the point, in ascending order of (distance, point id). All sums run in that order,
//! so a plane depends on the neighbors alone, bit for bit.
//!
//! The robust fit follows the idea of OPALS' "robustPlane": planes are fitted with weights by the residuals (Huber 1964,
//! then Beaton and Tukey 1974, on the scale of Rousseeuw and Leroy 1987) until it is clear which neighbors are blunders;
//! these are removed, and what is left is fitted with equal weights. Where nothing is removed, it is the least squares
//! fit, bit for bit.

use super::eigen::{Eigen, dot, eigen};

/// Neighbors whose second axis is shorter than this, squared and relative to the first, lie on a line.
const LINE: f64 = 1e-12;

/// A component of a normal below this is 0.
const UPRIGHT: f64 = 1e-12;

/// Huber's and Tukey's constants, in standard deviations: 95 % efficiency at normally distributed residuals.
const HUBER: f64 = 1.345;
const TUKEY: f64 = 4.685;

/// Rounds of weighting: the first ones bound the influence of blunders, the others take it away.
const HUBER_ROUNDS: usize = 5;
const ROUNDS: usize = 25;

/// A plane, and how the points that it was fitted to lie about it.
pub(super) struct Plane {
    points: usize,
    pub(super) mean: [f64; 3],
    /// Unit vectors along the largest spread, the middle one, and the normal.
    pub(super) axes: [[f64; 3]; 3],
    /// Variances along the axes, with the number of points as divisor, descending.
    pub(super) variances: [f64; 3],
}

impl Plane {
    /// The plane through `offsets`; none if they are fewer than three. It means little where [`Self::is_line`].
    pub(super) fn fit(offsets: &[[f64; 3]]) -> Option<Plane> {
        (offsets.len() >= 3).then(|| weighted(offsets, |_| 1.0))
    }

    /// Whether the points lie on a line or at one place, so that there are many planes.
    pub(super) fn is_line(&self) -> bool {
        self.variances[1] <= LINE * self.variances[0]
    }

    /// The unit normal that points upward: z > 0, else y > 0, else x > 0.
    pub(super) fn normal(&self) -> [f64; 3] {
        // Rounding must not decide which side of a wall is up.
        let [x, y, z] = self.axes[2].map(|c| if c.abs() < UPRIGHT { 0.0 } else { c });
        let sign = if z != 0.0 {
            z
        } else if y != 0.0 {
            y
        } else {
            x
        };
        // Adding zero makes 0 of −0.
        [x, y, z].map(|c| c * 1f64.copysign(sign) + 0.0)
    }

    /// Standard deviation of a point's distance from the plane, which takes three of the observations.
    pub(super) fn sigma0(&self) -> f64 {
        if self.points == 3 {
            return 0.0;
        }
        (self.variances[2] * self.points as f64 / (self.points - 3) as f64).sqrt()
    }

    fn distance(&self, offset: &[f64; 3]) -> f64 {
        dot(self.axes[2], from(self.mean, offset)).abs()
    }
}

fn from(mean: [f64; 3], offset: &[f64; 3]) -> [f64; 3] {
    [offset[0] - mean[0], offset[1] - mean[1], offset[2] - mean[2]]
}

/// The plane in which the point of each number has a weight.
fn weighted(offsets: &[[f64; 3]], weight: impl Fn(usize) -> f64) -> Plane {
    let (mut total, mut sums) = (0.0, [0.0; 3]);
    for (i, offset) in offsets.iter().enumerate() {
        let w = weight(i);
        total += w;
        for k in 0..3 {
            sums[k] += w * offset[k];
        }
    }
    let mean = sums.map(|sum| sum / total);
    let mut squares = [0.0; 6];
    for (i, offset) in offsets.iter().enumerate() {
        let w = weight(i);
        let [x, y, z] = from(mean, offset);
        let products = [x * x, x * y, x * z, y * y, y * z, z * z];
        for k in 0..6 {
            squares[k] += w * products[k];
        }
    }
    let Eigen { values, vectors } = eigen(&squares.map(|sum| sum / total));
    // Across a thin plane the eigenvalue has lost its digits to the large ones; the distances themselves have not.
    let mut thickness = 0.0;
    for (i, offset) in offsets.iter().enumerate() {
        let distance = dot(vectors[2], from(mean, offset));
        thickness += weight(i) * distance * distance;
    }
    let middle = values[1].max(0.0);
    let variances = [values[0], middle, (thickness / total).min(middle)];
    Plane { points: offsets.len(), mean, axes: vectors, variances }
}

/// Working memory of the robust fit.
#[derive(Default)]
pub(super) struct Robust {
    weights: Vec<f64>,
    distances: Vec<f64>,
    ranked: Vec<f64>,
}

impl Robust {
    /// Removes the blunders from `offsets`. `steps` are the lengths of a lattice step along the axes, or zero:
    /// what rounding to the lattice does is no blunder.
    pub(super) fn remove_blunders(&mut self, offsets: &mut Vec<[f64; 3]>, steps: [f64; 3]) {
        // Three points are the plane.
        if offsets.len() <= 3 {
            return;
        }
        self.weights.clear();
        self.weights.resize(offsets.len(), 1.0);
        let mut settled = false;
        for round in 0..ROUNDS {
            let plane = weighted(offsets, |i| self.weights[i]);
            let deviation = self.deviation(offsets, &plane, steps);
            let reweight = if round < HUBER_ROUNDS { huber } else { tukey };
            let mut unchanged = round > HUBER_ROUNDS;
            for (weight, distance) in self.weights.iter_mut().zip(&self.distances) {
                let new = reweight(distance / deviation);
                unchanged &= (*weight > 0.0) == (new > 0.0);
                *weight = new;
            }
            if unchanged && settled {
                break;
            }
            settled = unchanged;
        }
        let mut weights = self.weights.iter();
        offsets.retain(|_| weights.next().is_some_and(|&weight| weight > 0.0));
    }

    /// A standard deviation of the distances from a plane that up to half of them cannot spoil; never 0.
    fn deviation(&mut self, offsets: &[[f64; 3]], plane: &Plane, steps: [f64; 3]) -> f64 {
        self.distances.clear();
        self.distances.extend(offsets.iter().map(|offset| plane.distance(offset)));
        self.ranked.clone_from(&self.distances);
        let n = offsets.len();
        // A little above the median: the plane passes near three of the points whatever the others are like.
        let (_, median, _) = self.ranked.select_nth_unstable_by((n / 2 + 1).min(n - 1), f64::total_cmp);
        let of_points = 1.4826 * (1.0 + 5.0 / (n - 3) as f64) * *median;
        let rounding: [f64; 3] = std::array::from_fn(|k| plane.axes[2][k] * steps[k]);
        let of_lattice = (dot(rounding, rounding) / 12.0).sqrt();
        // Where most points are in a plane exactly, their distances from it are the rounding of numbers of this size.
        let of_numbers = 1e-9 * plane.variances[0].sqrt();
        of_points.max(of_lattice).max(of_numbers).max(f64::MIN_POSITIVE)
    }
}

fn huber(residual: f64) -> f64 {
    if residual <= HUBER { 1.0 } else { HUBER / residual }
}

fn tukey(residual: f64) -> f64 {
    let rest = 1.0 - (residual / TUKEY) * (residual / TUKEY);
    if rest > 0.0 { rest * rest } else { 0.0 }
}
