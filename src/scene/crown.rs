//! A cloud of leaves in an ellipsoid: pulses are intercepted piece by piece on their way through it.
//!
//! Leaves come in clumps that stay where they are (a hash of the place decides), so that neighbouring pulses see the same
//! gaps, and grow more densely near the surface, where the light is.

use super::geometry::{Bounds, Ray, Vector, add, dot, subtract};
use super::random::{Random, hash, to_unit};
use super::shape::Hit;

/// Edge of a clump of leaves, metres.
const CLUMP: f64 = 0.45;
/// Share of the clumps that hold leaves.
const LEAFY: f64 = 0.62;
/// Distance between looks on the way through a crown, metres.
const STRIDE: f64 = 0.3;
/// A pulse with less than this share of its energy left is followed no further.
const SPENT: f64 = 0.05;

/// An ellipsoid filled with leaves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crown {
    /// Its middle.
    pub(super) center: Vector,
    /// Half axes along x, y and z, metres.
    pub(super) radii: Vector,
    /// Probability that a look into a clump at the surface meets a leaf.
    pub(super) density: f64,
}

impl Crown {
    /// The smallest box around the crown.
    pub(super) fn bounds(&self) -> Bounds {
        Bounds { low: subtract(self.center, self.radii), high: add(self.center, self.radii) }
    }

    /// Adds what a ray meets inside the crown between the two distances.
    pub(super) fn hit(&self, ray: &Ray, from: f64, to: f64, random: &mut Random, mut found: impl FnMut(Hit)) {
        let Some((enter, leave)) = self.chord(ray) else { return };
        let (enter, leave) = (enter.max(from), leave.min(to));
        let mut energy = 1.0;
        let mut distance = enter + STRIDE * random.unit();
        while distance < leave && energy > SPENT {
            let point = ray.at(distance);
            let chance = self.density * (0.3 + 0.7 * self.depth(point));
            if is_leafy(point) && random.chance(chance) {
                let coverage = random.between(0.25, 0.9);
                energy *= 1.0 - coverage;
                found(Hit { distance, coverage, cosine: random.between(0.3, 1.0), brightness: 1.0, part: 0 });
            }
            distance += STRIDE;
        }
    }

    /// Squared distance from the middle in half axes: 0 in the middle, 1 on the surface.
    fn depth(&self, point: Vector) -> f64 {
        let local = self.in_half_axes(subtract(point, self.center));
        dot(local, local)
    }

    fn in_half_axes(&self, offset: Vector) -> Vector {
        [offset[0] / self.radii[0], offset[1] / self.radii[1], offset[2] / self.radii[2]]
    }

    /// Distances at which a ray enters and leaves the ellipsoid.
    fn chord(&self, ray: &Ray) -> Option<(f64, f64)> {
        let origin = self.in_half_axes(subtract(ray.origin, self.center));
        let direction = self.in_half_axes(ray.direction);
        let (square, half, rest) = (dot(direction, direction), dot(origin, direction), dot(origin, origin) - 1.0);
        let discriminant = half * half - square * rest;
        (discriminant > 0.0).then(|| {
            let root = discriminant.sqrt();
            ((-half - root) / square, (-half + root) / square)
        })
    }
}

/// Whether the clump around a point holds leaves.
fn is_leafy(point: Vector) -> bool {
    const FOLIAGE: u64 = 0x1eaf;
    let [x, y, z] = point.map(|coordinate| (coordinate / CLUMP).floor() as i64);
    to_unit(hash(FOLIAGE, x, (y << 16) ^ z)) < LEAFY
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hits_stay_inside_and_some_pulses_pass() {
        let crown = Crown { center: [0.0, 0.0, 10.0], radii: [3.0, 2.0, 4.0], density: 0.3 };
        let mut random = Random::at(7, 0, 0);
        let mut passed = 0;
        for step in 0..400 {
            let x = f64::from(step % 20) * 0.2 - 2.0;
            let y = f64::from(step / 20) * 0.1 - 1.0;
            let ray = Ray { origin: [x, y, 100.0], direction: [0.0, 0.0, -1.0], aperture: 0.1, spread: 0.0 };
            let mut hits = Vec::new();
            crown.hit(&ray, 0.0, 200.0, &mut random, |hit| hits.push(hit));
            assert!(hits.iter().all(|hit| crown.depth(ray.at(hit.distance)) <= 1.0));
            assert!(hits.is_sorted_by(|a, b| a.distance < b.distance));
            passed += u32::from(hits.iter().map(|hit| 1.0 - hit.coverage).product::<f64>() > 0.5);
        }
        assert!((4..300).contains(&passed), "{passed} of 400 pulses passed");
    }
}
