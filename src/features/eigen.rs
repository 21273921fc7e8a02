//! Eigenvalues and eigenvectors of a symmetric 3 × 3 matrix, to the last digits of the largest eigenvalue.
//!
//! In closed form (Smith 1961), made robust as Eberly (2014) does it: first the eigenvector whose eigenvalue lies
//! farthest from the other two, then the other two within the plane across it. There we depart from Eberly: a rotation
//! (Jacobi 1846) solves the remaining 2 × 2 matrix, values and vectors at once, so nearly equal eigenvalues lose no
//! digits. Libraries do not: glamx finds the smallest eigenvalue's vector first, however near the next one is, and
//! nalgebra iterates, which takes several times as long.

use std::f64::consts::PI;

/// A symmetric matrix: xx, xy, xz, yy, yz, zz.
pub(crate) type Symmetric = [f64; 6];

/// Eigenvalues in descending order, and their unit eigenvectors, which form a right or left-handed frame.
pub(crate) struct Eigen {
    pub(crate) values: [f64; 3],
    pub(crate) vectors: [[f64; 3]; 3],
}

/// Decomposes a finite matrix. Where eigenvalues are equal, some fixed choice of vectors is made.
pub(crate) fn eigen(matrix: &Symmetric) -> Eigen {
    let largest = matrix.iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
    if largest == 0.0 {
        return Eigen { values: [0.0; 3], vectors: AXES };
    }
    let scaled = matrix.map(|entry| entry / largest);
    let mean = (scaled[0] + scaled[3] + scaled[5]) / 3.0;
    let rest = less(&scaled, mean);
    let (apart, lone) = loneliest(&rest);
    let (u, v) = across(lone);
    let pairs = sorted([(apart, lone)].into_iter().chain(within(&rest, u, v)));
    Eigen { values: pairs.map(|(value, _)| (value + mean) * largest), vectors: pairs.map(|(_, vector)| vector) }
}

const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// An eigenvalue and its eigenvector.
type Pair = (f64, [f64; 3]);

/// The eigenvalue of a matrix of trace zero that lies farthest from the others.
fn loneliest(matrix: &Symmetric) -> Pair {
    let [xx, xy, xz, yy, yz, zz] = *matrix;
    let size = ((xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0).sqrt();
    if size == 0.0 {
        return (0.0, AXES[0]);
    }
    // The eigenvalues of the matrix over `size` are 2 cos φ and 120° to either side.
    let unit = matrix.map(|entry| entry / size);
    let angle = (determinant(&unit) / 2.0).clamp(-1.0, 1.0).acos() / 3.0;
    let value = if angle <= PI / 6.0 { 2.0 * angle.cos() } else { 2.0 * (angle + 2.0 * PI / 3.0).cos() };
    // The other two are at least √3 away, so two rows of what is left span the plane across the eigenvector.
    let [xx, xy, xz, yy, yz, zz] = less(&unit, value);
    let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let crosses = [cross(rows[0], rows[1]), cross(rows[0], rows[2]), cross(rows[1], rows[2])];
    let mut best = crosses[0];
    for other in &crosses[1..] {
        if dot(*other, *other) > dot(best, best) {
            best = *other;
        }
    }
    let length = dot(best, best).sqrt();
    let vector = best.map(|c| c / length);
    (dot(vector, times(matrix, vector)), vector)
}

/// The two eigenvalues whose vectors lie in the plane of the unit vectors `u` and `v`.
fn within(matrix: &Symmetric, u: [f64; 3], v: [f64; 3]) -> [Pair; 2] {
    let (to_u, to_v) = (times(matrix, u), times(matrix, v));
    let (uu, uv, vv) = (dot(u, to_u), dot(u, to_v), dot(v, to_v));
    if uv == 0.0 {
        return [(uu, u), (vv, v)];
    }
    let tau = (vv - uu) / (2.0 * uv);
    let tangent = 1f64.copysign(tau) / (tau.abs() + (1.0 + tau * tau).sqrt());
    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
    let sine = tangent * cosine;
    let turned_u = std::array::from_fn(|i| cosine * u[i] - sine * v[i]);
    let turned_v = std::array::from_fn(|i| sine * u[i] + cosine * v[i]);
    [(uu - tangent * uv, turned_u), (vv + tangent * uv, turned_v)]
}

/// Two unit vectors across a unit vector and across each other.
fn across(vector: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let [x, y, z] = vector;
    let u = if x.abs() > y.abs() { [-z, 0.0, x] } else { [0.0, z, -y] };
    let length = dot(u, u).sqrt();
    let u = u.map(|c| c / length);
    (u, cross(vector, u))
}

fn sorted(pairs: impl Iterator<Item = Pair>) -> [Pair; 3] {
    let mut sorted = [(f64::NEG_INFINITY, [0.0; 3]); 3];
    for pair in pairs {
        let place = if pair.0 > sorted[0].0 {
            0
        } else if pair.0 > sorted[1].0 {
            1
        } else {
            2
        };
        sorted[place..].rotate_right(1);
        sorted[place] = pair;
    }
    sorted
}

fn less(matrix: &Symmetric, diagonal: f64) -> Symmetric {
    let [xx, xy, xz, yy, yz, zz] = *matrix;
    [xx - diagonal, xy, xz, yy - diagonal, yz, zz - diagonal]
}

fn determinant(matrix: &Symmetric) -> f64 {
    let [xx, xy, xz, yy, yz, zz] = *matrix;
    xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
}

fn times(matrix: &Symmetric, v: [f64; 3]) -> [f64; 3] {
    let [xx, xy, xz, yy, yz, zz] = *matrix;
    [xx * v[0] + xy * v[1] + xz * v[2], xy * v[0] + yy * v[1] + yz * v[2], xz * v[0] + yz * v[1] + zz * v[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Values, vectors and their being orthonormal, all by what defines them.
    fn check(matrix: &Symmetric) {
        let size = matrix.iter().fold(0.0, |size: f64, entry| size.max(entry.abs()));
        let Eigen { values, vectors } = eigen(matrix);
        assert!(values[0] >= values[1] && values[1] >= values[2], "{values:?}");
        for i in 0..3 {
            let image = times(matrix, vectors[i]);
            for k in 0..3 {
                let off = (image[k] - values[i] * vectors[i][k]).abs();
                assert!(off <= 1e-14 * size, "{matrix:?}: value {i} of {values:?} is off by {off:e}");
            }
            for j in 0..=i {
                let off = (dot(vectors[i], vectors[j]) - f64::from(u8::from(i == j))).abs();
                assert!(off <= 1e-14, "{matrix:?}: vectors {i} and {j} by {off:e}");
            }
        }
    }

    /// The matrix with these eigenvalues, turned by two angles.
    fn turned(values: [f64; 3], a: f64, b: f64) -> Symmetric {
        let (p, q) = ([a.cos(), a.sin(), 0.0], [-a.sin() * b.cos(), a.cos() * b.cos(), b.sin()]);
        let frame = [p, q, cross(p, q)];
        let entry = |i: usize, j: usize| (0..3).map(|k| values[k] * frame[k][i] * frame[k][j]).sum();
        [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)]
    }

    proptest! {
        #[test]
        fn any_matrix(matrix in prop::array::uniform6(-1.0f64..1.0)) {
            check(&matrix);
        }

        #[test]
        fn small_whole_numbers(matrix in prop::array::uniform6(-2i8..=2)) {
            check(&matrix.map(f64::from));
        }

        /// Nearly equal eigenvalues are where closed forms lose half of their digits.
        #[test]
        fn near_ties(gaps in prop::array::uniform2(0i32..18), size in -100i32..100, a in 0.0f64..7.0, b in 0.0f64..7.0) {
            let size = 10f64.powi(size);
            let gap = gaps.map(|gap: i32| if gap == 17 { 0.0 } else { 10f64.powi(-gap) });
            check(&turned([size * (1.0 + gap[0] + gap[1]), size * (1.0 + gap[1]), size], a, b));
            check(&turned([size, size * gap[0], size * gap[0] * gap[1]], a, b));
        }
    }

    #[test]
    fn special_matrices() {
        check(&[0.0; 6]);
        check(&[1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
        check(&[1.0; 6]);
        check(&[1e-300, 0.0, 0.0, 2e-300, 1e-301, 3e-300]);
        check(&[1e300, 0.0, 0.0, 2e300, 1e299, 3e300]);
        // A wall: its normal has zeros where it should.
        let normal = eigen(&[0.0, 0.0, 0.0, 2.0, 0.7, 1.0]).vectors[2];
        assert_eq!(normal.map(f64::abs), [1.0, 0.0, 0.0]);
    }
}
