//! Which Delaunay edges of a window are edges of the whole cloud's triangulation, whatever else may come.
//!
//! An edge is Delaunay as long as one circle through its ends is empty. So if such a circle lies inside the part of
//! space that has been loaded completely, no later point can undo the edge (the finalization rule of Isenburg, Liu,
//! Shewchuk and Snoeyink 2006, for edges instead of triangles).
//!
//! The circles through the ends p, q have their centers on the bisector, at m + t·n with m the middle of the edge, n the
//! unit normal to its left, and the radius √(h² + t²) with h = |pq|/2. Those between the circumcircles of the triangles to
//! the right and to the left, t ∈ \[right, left\], are empty. The loaded part is a slab, low ≤ u·x ≤ high; a circle is
//! inside if low ≤ u·m + t·(u·n) ∓ √(h² + t²) ≤ high, which again is an interval of t on either side.

/// The part of the map, across a direction, in which all points of the cloud have been loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loaded {
    /// Unit vector across the slab.
    pub direction: [f64; 2],
    /// Lower border along the direction; −∞ if nothing lies beyond.
    pub low: f64,
    /// Upper border; +∞ if nothing lies beyond.
    pub high: f64,
}

impl Loaded {
    /// Whether some empty circle through `p` and `q` lies inside. `left` and `right` are the third corners of the
    /// triangles on either side of the edge; a hull edge has none on one side.
    pub fn proves(&self, p: [f64; 2], q: [f64; 2], left: Option<[f64; 2]>, right: Option<[f64; 2]>) -> bool {
        if self.low == f64::NEG_INFINITY && self.high == f64::INFINITY {
            return true;
        }
        let middle = [f64::midpoint(p[0], q[0]), f64::midpoint(p[1], q[1])];
        let half = [(q[0] - p[0]) / 2.0, (q[1] - p[1]) / 2.0];
        let h2 = half[0] * half[0] + half[1] * half[1];
        let h = h2.sqrt();
        let normal = [-half[1] / h, half[0] / h];
        // Where the circle also passes through `corner`. `side` is 1 for a corner to the left and −1 for one to the right,
        // as the triangulation has it: rounding must not turn a thin triangle over.
        let through = |corner: [f64; 2], side: f64| {
            let v = [corner[0] - middle[0], corner[1] - middle[1]];
            let across = (side * (normal[0] * v[0] + normal[1] * v[1])).max(f64::MIN_POSITIVE);
            side * (v[0] * v[0] + v[1] * v[1] - h2) / (2.0 * across)
        };
        let empty = (
            right.map_or(f64::NEG_INFINITY, |corner| through(corner, -1.0)),
            left.map_or(f64::INFINITY, |corner| through(corner, 1.0)),
        );
        let along = self.direction[0] * middle[0] + self.direction[1] * middle[1];
        let slope = self.direction[0] * normal[0] + self.direction[1] * normal[1];
        let below_high = inside(self.high - along, slope, h2);
        let above_low = inside(along - self.low, -slope, h2);
        empty.0.max(below_high.0).max(above_low.0) <= empty.1.min(below_high.1).min(above_low.1)
    }
}

impl Loaded {
    /// Whether the circle through three places lies inside.
    pub fn holds_circle(&self, corners: &[[f64; 2]; 3]) -> bool {
        let [a, b, c] = corners;
        let (b, c) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let [b2, c2] = [b, c].map(|v| v[0] * v[0] + v[1] * v[1]);
        let cross = 2.0 * (b[0] * c[1] - b[1] * c[0]);
        let center = [(c[1] * b2 - b[1] * c2) / cross, (b[0] * c2 - c[0] * b2) / cross];
        let radius = center[0].hypot(center[1]);
        let along = self.direction[0] * (a[0] + center[0]) + self.direction[1] * (a[1] + center[1]);
        // What is not sure because of rounding is not proven.
        let reach = radius + (radius + along.abs()) * 1e-12;
        self.low <= along - reach && along + reach <= self.high
    }
}

/// The interval of t with slope·t + √(h² + t²) ≤ room; (∞, −∞) if there is none.
fn inside(room: f64, slope: f64, h2: f64) -> (f64, f64) {
    const NEVER: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);
    if room == f64::INFINITY {
        return (f64::NEG_INFINITY, f64::INFINITY);
    }
    let across = 1.0 - slope * slope;
    // The smallest value is h·√across, at t = −slope·h/√across.
    let discriminant = room * room - h2 * across;
    if room < 0.0 || discriminant < 0.0 {
        return NEVER;
    }
    if across < 1e-12 {
        // The edge runs along the border: ±t + √(h² + t²) ≤ room is a half-line.
        let limit = (room * room - h2) / (2.0 * room);
        return match (room > 0.0, slope > 0.0) {
            (false, _) => NEVER,
            (true, true) => (f64::NEG_INFINITY, limit),
            (true, false) => (-limit, f64::INFINITY),
        };
    }
    let (center, root) = (-slope * room, discriminant.sqrt());
    ((center - root) / across, (center + root) / across)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Against trying many circles.
        #[test]
        fn the_interval_holds_the_circles_that_fit(
            room in -1.0f64..10.0, angle in 0.0f64..7.0, h in 0.01f64..5.0, t in -20.0f64..20.0
        ) {
            let slope = angle.sin();
            let (low, high) = inside(room, slope, h * h);
            let spare = room - (slope * t + (h * h + t * t).sqrt());
            if spare > 1e-6 {
                prop_assert!(low <= t && t <= high);
            } else if spare < -1e-6 {
                prop_assert!(t < low || high < t);
            }
        }
    }

    #[test]
    fn an_edge_near_the_border_needs_a_circle_that_fits() {
        let loaded = |high| Loaded { direction: [1.0, 0.0], low: f64::NEG_INFINITY, high };
        let (p, q) = ([0.0, -1.0], [0.0, 1.0]);
        let far_left = Some([-9.0, 0.0]);
        // Nothing to the right: the smallest circle, of radius 1, has to fit, or a larger one that leans to the left.
        assert!(loaded(1.0).proves(p, q, far_left, None));
        assert!(loaded(0.3).proves(p, q, far_left, None));
        assert!(!loaded(0.1).proves(p, q, far_left, None));
        // A near corner to the left leaves only circles that lean to the right.
        assert!(!loaded(1.0).proves(p, q, Some([-0.5, 0.0]), None));
        assert!(loaded(2.1).proves(p, q, Some([-0.5, 0.0]), None));
        assert!(loaded(f64::INFINITY).proves(p, q, Some([-0.5, 0.0]), None));
    }
}
