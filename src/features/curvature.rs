//! Mean, Gaussian and principal curvatures of the surface around a point.
//!
//! A quadric height field z = a + bx + cy + dx² + exy + fy² is fitted by least squares to the neighbors, in the frame of
//! their plane (e.g. Hamann 1993). It is not forced through the point, which has an error like all others. Its fundamental
//! forms at the foot of the point give the curvatures, slopes included (do Carmo 1976, section 3.3).
//!
//! Along each axis coordinates are counted from the mean in standard deviations. So the normal equations are as well
//! conditioned as the points are spread, whatever the units and however long and narrow the neighborhood.

use super::eigen::dot;
use super::plane::Plane;

/// Where a column of the quadric, less the columns before it, keeps no more than this of its sum of squares, the
/// points do not tell it apart from them: they lie on two lines, say, or on another conic.
const SPREAD: f64 = 1e-6;

/// Powers of x and y in the terms of a quadric.
const TERMS: [(usize, usize); 6] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];

/// Curvatures; positive where the surface bends toward its upward normal, as a bowl does.
pub(super) struct Curvature {
    pub(super) mean: f64,
    pub(super) gaussian: f64,
    pub(super) max: f64,
    pub(super) min: f64,
}

impl Curvature {
    /// The curvatures at the origin of `offsets`; none if the points are too few or not spread enough.
    pub(super) fn fit(offsets: &[[f64; 3]], plane: &Plane) -> Option<Curvature> {
        if offsets.len() < TERMS.len() || plane.is_line() {
            return None;
        }
        let local = Local::new(plane);
        let mut moments = [[0.0; 5]; 5];
        let mut heights = [0.0; 6];
        for offset in offsets {
            let [x, y, z] = local.place(offset);
            let (xs, ys) = (powers(x), powers(y));
            for i in 0..5 {
                for j in 0..5 - i {
                    moments[i][j] += xs[i] * ys[j];
                }
            }
            for (sum, (i, j)) in heights.iter_mut().zip(TERMS) {
                *sum += xs[i] * ys[j] * z;
            }
        }
        let normal_matrix = TERMS.map(|(i, j)| TERMS.map(|(k, l)| moments[i + k][j + l]));
        let quadric = solve(normal_matrix, heights)?;
        Some(local.curvature(&quadric))
    }
}

/// The frame of a plane: two axes counted in standard deviations, and the height above it.
struct Local<'a> {
    plane: &'a Plane,
    normal: [f64; 3],
    deviations: [f64; 2],
}

impl<'a> Local<'a> {
    fn new(plane: &'a Plane) -> Self {
        let deviations = [plane.variances[0].sqrt(), plane.variances[1].sqrt()];
        Self { plane, normal: plane.normal(), deviations }
    }

    fn place(&self, offset: &[f64; 3]) -> [f64; 3] {
        let from_mean: [f64; 3] = std::array::from_fn(|k| offset[k] - self.plane.mean[k]);
        let along = |k: usize| dot(self.plane.axes[k], from_mean) / self.deviations[k];
        [along(0), along(1), dot(self.normal, from_mean)]
    }

    fn curvature(&self, quadric: &[f64; 6]) -> Curvature {
        let [x, y, _] = self.place(&[0.0; 3]);
        let [_, b, c, d, e, f] = *quadric;
        let [s, t] = self.deviations;
        let slope = [(b + 2.0 * d * x + e * y) / s, (c + e * x + 2.0 * f * y) / t];
        from_derivatives(slope, [2.0 * d / s / s, e / s / t, 2.0 * f / t / t])
    }
}

/// Curvatures of a height field with these first and second derivatives.
///
/// The second fundamental form in an orthonormal basis of the tangent plane (by Cholesky's factor of the first form) is
/// symmetric; its eigenvalues H ± √(H² − K) come without the cancellation in H² − K.
fn from_derivatives([zx, zy]: [f64; 2], [zxx, zxy, zyy]: [f64; 3]) -> Curvature {
    let area = (1.0 + zx * zx + zy * zy).sqrt();
    let first = (1.0 + zx * zx).sqrt();
    let second = area / first;
    let skew = zx * zy / first;
    let (xx, xy) = (zxx / first / first, zxy / first - skew * zxx / first / first);
    let yy = zyy - 2.0 * skew * zxy / first + skew * skew * zxx / first / first;
    let [xx, xy, yy] = [xx / area, xy / second / area, yy / second / second / area];
    let mean = f64::midpoint(xx, yy);
    let apart = ((xx - yy) / 2.0).hypot(xy);
    Curvature { mean, gaussian: xx * yy - xy * xy, max: mean + apart, min: mean - apart }
}

fn powers(x: f64) -> [f64; 5] {
    [1.0, x, x * x, x * x * x, x * x * x * x]
}

/// Solves normal equations by Cholesky's decomposition; none if the unknowns are not determined.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    for j in 0..N {
        let whole = matrix[j][j];
        let before: f64 = (0..j).map(|k| matrix[j][k] * matrix[j][k]).sum();
        let left = Some(whole - before).filter(|&left| left > SPREAD * whole)?;
        let pivot = left.sqrt();
        matrix[j][j] = pivot;
        for i in j + 1..N {
            let before: f64 = (0..j).map(|k| matrix[i][k] * matrix[j][k]).sum();
            matrix[i][j] = (matrix[i][j] - before) / pivot;
        }
    }
    for i in 0..N {
        let before: f64 = (0..i).map(|k| matrix[i][k] * right[k]).sum();
        right[i] = (right[i] - before) / matrix[i][i];
    }
    for i in (0..N).rev() {
        let after: f64 = (i + 1..N).map(|k| matrix[k][i] * right[k]).sum();
        right[i] = (right[i] - after) / matrix[i][i];
    }
    Some(right)
}
