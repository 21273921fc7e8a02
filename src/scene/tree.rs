//! Trees and bushes: a trunk and a crown of overlapping ellipsoids.

use super::crown::Crown;
use super::geometry::{Vector, add, heading};
use super::random::Random;
use super::rod::Rod;
use super::shape::{Kind, Object, Shape};

const LEAF_REFLECTANCE: f64 = 0.5;

/// Measures of a tree, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tree {
    /// From the ground to the top.
    pub(super) height: f64,
    /// No leaf is farther from the trunk.
    pub(super) crown_radius: f64,
    /// From the ground to the lowest leaves.
    pub(super) clear_trunk: f64,
    /// A spire of tiers instead of a round crown.
    pub(super) is_conifer: bool,
}

impl Tree {
    /// The tree as an object that stands on the ground at `foot`.
    pub(super) fn build(&self, foot: Vector, random: &mut Random) -> Object {
        let mut shapes = if self.is_conifer { self.spire(foot) } else { self.round_crown(foot, random) };
        // The trunk ends where the crown is thickest; above, branches take its place.
        let top = 0.5 * (self.clear_trunk + self.height);
        let trunk = Rod {
            start: add(foot, [0.0, 0.0, -0.5]),
            end: add(foot, [0.0, 0.0, top]),
            radius: 0.05 + 0.015 * self.height,
        };
        shapes.push(Shape::Rod(trunk));
        Object::of(Kind::Vegetation, LEAF_REFLECTANCE, foot[2], shapes)
    }

    /// One large ellipsoid and five lobes around it.
    fn round_crown(&self, foot: Vector, random: &mut Random) -> Vec<Shape> {
        let half_height = (self.height - self.clear_trunk) / 2.0;
        let middle = add(foot, [0.0, 0.0, self.clear_trunk + half_height]);
        let core = 0.72 * self.crown_radius;
        let mut shapes = vec![leaves(middle, [core, core, half_height], 0.2)];
        let turn = random.between(0.0, 0.4);
        for number in 0..5 {
            // Half-angle tangents that spread five directions over the circle.
            let [x, y] = heading([-2.2, -0.65, 0.0, 0.65, 2.2][number] + turn);
            let size = random.between(0.42, 0.55) * self.crown_radius;
            let rise = random.between(-0.35, 0.45) * half_height;
            let reach = self.crown_radius - size;
            let tall = (0.95 * size).min(half_height - rise.abs());
            shapes.push(leaves(add(middle, [x * reach, y * reach, rise]), [size, size, tall], 0.26));
        }
        shapes
    }

    /// Flat tiers that narrow towards the top.
    fn spire(&self, foot: Vector) -> Vec<Shape> {
        const TIERS: u32 = 6;
        let crown = self.height - self.clear_trunk;
        let tier = |number: u32| {
            let share = f64::from(number) / f64::from(TIERS);
            let radius = self.crown_radius * (1.0 - 0.88 * share);
            let half = crown / f64::from(TIERS) * 0.85;
            let middle = self.clear_trunk + half + share * (crown - half * 0.9);
            leaves(add(foot, [0.0, 0.0, middle.min(self.height - half)]), [radius, radius, half], 0.4)
        };
        (0..TIERS).map(tier).collect()
    }
}

/// A bush that stands on the ground at `foot`, as an object.
pub(super) fn bush(foot: Vector, radius: f64, height: f64) -> Object {
    let middle = add(foot, [0.0, 0.0, height * 0.45]);
    Object::of(Kind::Vegetation, LEAF_REFLECTANCE, foot[2], vec![leaves(middle, [radius, radius, height * 0.55], 0.5)])
}

fn leaves(center: Vector, radii: Vector, density: f64) -> Shape {
    Shape::Crown(Crown { center, radii, density })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_tree_is_larger_than_its_measures() {
        for is_conifer in [false, true] {
            let tree = Tree { height: 14.0, crown_radius: 3.0, clear_trunk: 2.5, is_conifer };
            for number in 0..50 {
                let bounds = tree.build([0.0; 3], &mut Random::at(9, number, 0)).bounds();
                assert!(bounds.high[2] <= 14.0 + 1e-9, "{bounds:?}");
                assert!(bounds.high[0] <= 3.0 + 1e-9 && bounds.low[1] >= -3.0 - 1e-9, "{bounds:?}");
            }
        }
    }
}
