//! Long thin things: poles, trunks, the members of a pylon, and the wires between them.
//!
//! A pulse is a cone, so it need not be aimed at a wire to hit it: what counts is the distance between the two axes.
//! Rods and wires narrower than the footprint let the rest of the pulse pass.

use super::geometry::{Bounds, Ray, Vector, add, between, dot, scale, subtract};
use super::shape::Hit;

/// A straight round bar with rounded ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rod {
    /// The middle of one end.
    pub(super) start: Vector,
    /// The middle of the other.
    pub(super) end: Vector,
    /// Metres.
    pub(super) radius: f64,
}

/// A wire that hangs between two supports.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wire {
    /// Where it leaves the first support.
    pub(super) start: Vector,
    /// Where it arrives at the second.
    pub(super) end: Vector,
    /// How far the middle hangs below the chord, metres.
    pub(super) sag: f64,
    /// Metres.
    pub(super) radius: f64,
}

/// The nearest approach of a ray to a segment.
struct Approach {
    /// Along the ray, metres.
    distance: f64,
    /// Along the segment, 0 to 1.
    share: f64,
    /// Squared distance between the two, square metres.
    gap: f64,
    /// Squared sine of the angle between the two.
    sine: f64,
}

impl Rod {
    /// The smallest box around the rod.
    pub(super) fn bounds(&self) -> Bounds {
        Bounds::around(&[self.start, self.end]).grown(self.radius)
    }

    /// Where a ray meets the rod, if it does so between the two distances.
    pub(super) fn hit(&self, ray: &Ray, from: f64, to: f64) -> Option<Hit> {
        let axis = subtract(self.end, self.start);
        let approach = Approach::of(ray, self.start, axis);
        let gap = approach.gap.sqrt();
        let coverage = coverage(gap, self.radius, ray.footprint(approach.distance))?;
        // From the axis back to the surface, half the chord of the ray through the round bar.
        let chord = (self.radius * self.radius - approach.gap).max(0.0).sqrt();
        let is_at_end = approach.share <= 0.0 || approach.share >= 1.0;
        let slant = if is_at_end { 1.0 } else { approach.sine.sqrt() };
        let mut distance = approach.distance - chord / slant.max(1e-6);
        // A ray nearly along the bar enters through its end instead.
        let advance = dot(ray.direction, axis);
        let share = approach.share + (distance - approach.distance) * advance / dot(axis, axis);
        if !is_at_end && !(0.0..=1.0).contains(&share) {
            distance = approach.distance + (share.clamp(0.0, 1.0) - approach.share) * dot(axis, axis) / advance;
        }
        let cosine =
            if self.radius > 0.0 { (1.0 - approach.gap / (self.radius * self.radius)).max(0.1).sqrt() } else { 1.0 };
        (from..to).contains(&distance).then_some(Hit { distance, coverage, cosine, brightness: 1.0, part: 0 })
    }
}

impl Wire {
    /// Height below the chord at a share of the span, metres: the catenary to the fourth order of its series.
    fn droop(&self, share: f64) -> (f64, f64) {
        let span = subtract(self.end, self.start);
        let square = 64.0 * self.sag * self.sag / (span[0] * span[0] + span[1] * span[1]);
        let (from_middle, bend) = (2.0 * share - 1.0, square / 48.0);
        let curve = from_middle * from_middle;
        let droop = self.sag * (1.0 - (curve + bend * curve * curve) / (1.0 + bend));
        let slope = -self.sag * 4.0 * (from_middle + 2.0 * bend * curve * from_middle) / (1.0 + bend);
        (droop, slope)
    }

    /// The point at a share of the span.
    pub(super) fn at(&self, share: f64) -> Vector {
        let chord = between(self.start, self.end, share);
        [chord[0], chord[1], chord[2] - self.droop(share).0]
    }

    /// The smallest box around the wire.
    pub(super) fn bounds(&self) -> Bounds {
        let lowest = add([0.0, 0.0, -self.sag], if self.start[2] < self.end[2] { self.start } else { self.end });
        Bounds::around(&[self.start, self.end, lowest]).grown(self.radius)
    }

    /// Where a ray meets the wire, if it does so between the two distances.
    ///
    /// The wire is replaced by its tangent where the ray came nearest to the last tangent, starting with the chord.
    pub(super) fn hit(&self, ray: &Ray, from: f64, to: f64) -> Option<Hit> {
        let span = subtract(self.end, self.start);
        let mut nearest = Approach::of(ray, self.start, span);
        for _ in 0..3 {
            let share = nearest.share;
            let tangent = add(span, [0.0, 0.0, -self.droop(share).1]);
            let foot = subtract(self.at(share), scale(tangent, share));
            nearest = Approach::of(ray, foot, tangent);
        }
        let coverage = coverage(nearest.gap.sqrt(), self.radius, ray.footprint(nearest.distance))?;
        let hit = Hit { distance: nearest.distance, coverage, cosine: 1.0, brightness: 1.0, part: 0 };
        (from..to).contains(&nearest.distance).then_some(hit)
    }
}

impl Approach {
    fn of(ray: &Ray, start: Vector, axis: Vector) -> Self {
        let from_start = subtract(ray.origin, start);
        let square = dot(axis, axis);
        let slant = dot(ray.direction, axis);
        let sine = (1.0 - slant * slant / square).max(0.0);
        let free_share = if sine > 1e-9 {
            (dot(from_start, axis) - dot(from_start, ray.direction) * slant) / (square * sine)
        } else {
            0.5
        };
        let share = free_share.clamp(0.0, 1.0);
        let nearest = subtract(add(start, scale(axis, share)), ray.origin);
        let distance = dot(nearest, ray.direction);
        let apart = subtract(nearest, scale(ray.direction, distance));
        Self { distance, share, gap: dot(apart, apart), sine }
    }
}

/// Share of the footprint that a bar of a radius covers at a distance between the axes; `None` when they do not touch.
fn coverage(gap: f64, radius: f64, footprint: f64) -> Option<f64> {
    let overlap = footprint + radius - gap;
    // Round metal and wood throw back more of the pulse than their share of its area: the factor of three is chosen
    // so that a wire seen from the air returns a point or two per metre and line, as flown data do.
    let widest = (3.0 * radius / footprint).min(1.0);
    (overlap > 0.0).then(|| (overlap / (2.0 * footprint)).min(1.0) * widest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pole_is_met_on_its_near_side_and_from_above_on_its_top() {
        let pole = Rod { start: [0.0, 0.0, 0.0], end: [0.0, 0.0, 6.0], radius: 0.1 };
        let level = Ray { origin: [-5.0, 0.0, 2.0], direction: [1.0, 0.0, 0.0], aperture: 0.001, spread: 0.0 };
        let side = pole.hit(&level, 0.0, 20.0).expect("the side");
        assert!((side.distance - 4.9).abs() < 1e-9);
        let above = Ray { origin: [0.02, 0.0, 9.0], direction: [0.0, 0.0, -1.0], ..level };
        let top = pole.hit(&above, 0.0, 20.0).expect("the top");
        assert!(top.distance < 3.2 && top.distance > 2.85, "{}", top.distance);
    }

    #[test]
    fn a_wire_hangs_by_its_sag_and_is_hit_where_it_hangs() {
        let wire = Wire { start: [0.0, 0.0, 20.0], end: [120.0, 0.0, 23.0], sag: 3.0, radius: 0.02 };
        assert!((wire.at(0.5)[2] - 18.5).abs() < 1e-9);
        for step in 1..20 {
            let on_wire = wire.at(f64::from(step) / 20.0);
            let origin = add(on_wire, [0.0, -8.0, 24.0]);
            let direction = super::super::geometry::unit(subtract(on_wire, origin));
            let ray = Ray { origin, direction, aperture: 0.001, spread: 0.0 };
            let hit = wire.hit(&ray, 0.0, 100.0).expect("aimed at the wire");
            let miss = subtract(ray.at(hit.distance), on_wire);
            assert!(dot(miss, miss) < 1e-6, "{miss:?}");
        }
    }
}
