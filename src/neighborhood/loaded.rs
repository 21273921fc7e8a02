//! Which circles lie where everything has been loaded, and so stay empty whatever else may come.
//!
//! An edge is Delaunay as long as one circle through its ends is empty, a triangle as long as its circumcircle is. So if
//! such a circle lies inside the part of the map that has been loaded completely, no later point can undo the edge or
//! triangle (the finalization rule of Isenburg, Liu, Shewchuk and Snoeyink 2006, also for edges).
//!
//! The circles through the ends p, q have their centers on the bisector, at m + t·n with m the middle of the edge, n the
//! unit normal to its left, and the radius √(h² + t²) with h = |pq|/2. Those between the circumcircles of the triangles to
//! the right and to the left, t ∈ \[right, left\], are empty. The loaded part is a slab, low ≤ u·x < high; a circle is
//! inside if low ≤ u·m + t·(u·n) ∓ √(h² + t²) < high, which again is an interval of t on either side.
//!
//! What is not sure because of rounding is not proven. With ε = 2⁻⁵³, a product of differences of coordinates is off by at
//! most 4ε of the product of their lengths. The circumcenter of a triangle with sides b, c from a common corner is N / 2X,
//! with |X| = |b×c| and N of terms no larger than |b||c|(|b| + |c|) ≤ 4R|b||c|. So it is off by less than 60ε·κR where
//! κ = |b||c| / |X| is the reciprocal of the sine of the angle at the corner, as long as κ is far below 1/ε. The sums that
//! lead from there to a border, and the choice of the slab into which a point outside has been put, are off by some ε of
//! the largest coordinate that is involved.

/// More than the rounding of a bound on t, relative: 9ε.
const OF_TURN: f64 = 1e-15;

/// More than the rounding of a center and of a radius together, relative to κR: 270ε.
const OF_CIRCUMCIRCLE: f64 = 3e-14;

/// Beyond this κ nothing is known of a circumcircle.
const THINNEST: f64 = 1e12;

/// More than the rounding of sums and slabs, relative to the coordinates: 900ε.
const OF_PLACE: f64 = 1e-13;

/// The part of the map, across a direction, in which all points of the cloud have been loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loaded {
    /// Unit vector across the slab.
    pub direction: [f64; 2],
    /// Lower border along the direction; −∞ if nothing lies beyond.
    pub low: f64,
    /// Upper border; +∞ if nothing lies beyond.
    pub high: f64,
    /// The largest number from which, together with a point's coordinates, it was computed on which side of a border the
    /// point lies, such as the offset of the coordinates.
    pub largest: f64,
}

impl Loaded {
    /// Whether nothing lies beyond.
    pub fn is_everything(&self) -> bool {
        self.low == f64::NEG_INFINITY && self.high == f64::INFINITY
    }

    /// Whether some empty circle through `p` and `q` is sure to lie inside. `left` and `right` are the third corners of
    /// the triangles on either side of the edge; a hull edge has none on one side.
    pub fn proves(&self, p: [f64; 2], q: [f64; 2], left: Option<[f64; 2]>, right: Option<[f64; 2]>) -> bool {
        if self.is_everything() {
            return true;
        }
        let middle = [f64::midpoint(p[0], q[0]), f64::midpoint(p[1], q[1])];
        let half = [(q[0] - p[0]) / 2.0, (q[1] - p[1]) / 2.0];
        let h2 = half[0] * half[0] + half[1] * half[1];
        let h = h2.sqrt();
        let normal = [-half[1] / h, half[0] / h];
        let along = self.along(middle);
        let slope = self.along(normal);
        let below_high = inside(self.high - along, slope, h2);
        let above_low = inside(along - self.low, -slope, h2);
        let empty = (
            right.map_or(f64::NEG_INFINITY, |corner| -least_turn(p, q, corner)),
            left.map_or(f64::INFINITY, |corner| least_turn(p, q, corner)),
        );
        let least = empty.0.max(below_high.0).max(above_low.0);
        let most = empty.1.min(below_high.1).min(above_low.1);
        // Of the circles that seem to be inside, one is looked at closely.
        let t = between(least, most, h);
        let center = [middle[0] + t * normal[0], middle[1] + t * normal[1]];
        least <= most && self.holds(center, (h2 + t * t).sqrt(), 0.0)
    }

    /// Whether the circle through three places is sure to lie inside.
    pub fn holds_circle(&self, corners: &[[f64; 2]; 3]) -> bool {
        let [a, b, c] = corners;
        let (b, c) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let [b2, c2] = [b, c].map(|v| v[0] * v[0] + v[1] * v[1]);
        let cross = b[0] * c[1] - b[1] * c[0];
        let kappa = (b2 * c2).sqrt() / cross.abs();
        let way = [(c[1] * b2 - b[1] * c2) / (2.0 * cross), (b[0] * c2 - c[0] * b2) / (2.0 * cross)];
        let radius = (way[0] * way[0] + way[1] * way[1]).sqrt();
        let center = [a[0] + way[0], a[1] + way[1]];
        kappa < THINNEST && self.holds(center, radius, OF_CIRCUMCIRCLE * kappa * radius)
    }

    /// Whether a disc lies inside, center and radius together being off by at most `off` beyond their last digits. It may
    /// not touch a border: a point there would be on the circle, with those that are there already.
    fn holds(&self, center: [f64; 2], radius: f64, off: f64) -> bool {
        let along = self.along(center);
        let reach = radius + off + OF_PLACE * (center[0].abs() + center[1].abs() + radius + self.largest);
        self.low < along - reach && along + reach < self.high
    }

    fn along(&self, place: [f64; 2]) -> f64 {
        self.direction[0] * place[0] + self.direction[1] * place[1]
    }
}

/// A number that t, counted toward `corner`, may take before the circle through `p`, `q` reaches the corner: at most
/// (p−c)·(q−c) h / |(q−p) × (c−p)|.
fn least_turn(p: [f64; 2], q: [f64; 2], corner: [f64; 2]) -> f64 {
    let from = |place: [f64; 2], to: [f64; 2]| [to[0] - place[0], to[1] - place[1]];
    let length = |v: [f64; 2]| (v[0] * v[0] + v[1] * v[1]).sqrt();
    let (chord, to_p, to_q) = (from(p, q), from(p, corner), from(q, corner));
    let (whole, way) = (length(chord), length(to_p));
    let dot = to_p[0] * to_q[0] + to_p[1] * to_q[1] - OF_TURN * way * length(to_q);
    let across = (chord[0] * to_p[1] - chord[1] * to_p[0]).abs();
    // The further across the corner is taken to be, the nearer to 0 is the turn.
    let across = across + OF_TURN * whole * way * if dot < 0.0 { -1.0 } else { 1.0 };
    if across <= 0.0 {
        return f64::NEG_INFINITY;
    }
    let turn = dot * (whole / 2.0) / across;
    turn - OF_TURN * turn.abs()
}

/// A number between two, one of which may be infinite; in steps of `step` from the other one then.
fn between(least: f64, most: f64, step: f64) -> f64 {
    match (least.is_finite(), most.is_finite()) {
        (true, true) => f64::midpoint(least, most),
        (true, false) => least + least.abs() + step,
        (false, true) => most - most.abs() - step,
        (false, false) => 0.0,
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

    fn loaded_below(high: f64) -> Loaded {
        Loaded { direction: [1.0, 0.0], low: f64::NEG_INFINITY, high, largest: 0.0 }
    }

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

        /// On whole numbers far from zero: top = center + radius < high is (2X·(high − a) − Nx)² > |N|², all exact in i128.
        #[test]
        fn a_circle_that_is_held_is_inside(
            at in prop::array::uniform2(-1i64 << 30..1 << 30),
            ends in prop::array::uniform4(-3000i64..3000), room in 0i64..10_000, thin in 0i64..3,
        ) {
            let b = [ends[0], ends[1]];
            // Thin triangles, of which rounding makes most.
            let c = if thin == 0 { [ends[2], ends[3]] } else { [7 * ends[0] + thin, 7 * ends[1] + 1] };
            let cross = 2 * i128::from(b[0] * c[1] - b[1] * c[0]);
            prop_assume!(cross != 0);
            let [b2, c2] = [b, c].map(|v| i128::from(v[0] * v[0] + v[1] * v[1]));
            let sign = cross.signum();
            let nx = sign * (i128::from(c[1]) * b2 - i128::from(b[1]) * c2);
            let ny = sign * (i128::from(b[0]) * c2 - i128::from(c[0]) * b2);
            let spare = cross.abs() * i128::from(room) - nx;
            let is_inside = spare > 0 && spare * spare > nx * nx + ny * ny;
            let place = |v: [i64; 2]| [(at[0] + v[0]) as f64, (at[1] + v[1]) as f64];
            let held = loaded_below((at[0] + room) as f64).holds_circle(&[place([0, 0]), place(b), place(c)]);
            prop_assert!(!held || is_inside);
            let is_well_inside = spare > 0 && (spare - cross.abs() / 2).pow(2) > nx * nx + ny * ny && 2 * spare > cross.abs();
            prop_assert!(held || !is_well_inside || thin != 0);
        }

        /// A circle that leans no further than that leaves the corner outside, exactly.
        #[test]
        fn a_turn_stops_before_the_corner(
            at in -1i64 << 40..1 << 40, q in prop::array::uniform2(-900i64..900), c in prop::array::uniform2(-9000i64..9000),
        ) {
            let cross = i128::from(q[0] * c[1] - q[1] * c[0]).abs();
            prop_assume!(cross != 0);
            let place = |v: [i64; 2]| [(at + v[0]) as f64, v[1] as f64];
            let turn = least_turn(place([0, 0]), place(q), place(c));
            // turn ≤ dot·h / cross, squared with its sign; h² = |q|² / 4.
            let dot = i128::from(c[0] * (c[0] - q[0]) + c[1] * (c[1] - q[1]));
            let exact = dot as f64 * (((q[0] * q[0] + q[1] * q[1]) as f64).sqrt() / 2.0) / cross as f64;
            prop_assert!(turn <= exact + exact.abs() * 1e-15);
            prop_assert!(turn >= exact - (1.0 + exact.abs()) * 1e-6 || cross < 10_000);
        }
    }

    #[test]
    fn an_edge_near_the_border_needs_a_circle_that_fits() {
        let (p, q) = ([0.0, -1.0], [0.0, 1.0]);
        let far_left = Some([-9.0, 0.0]);
        // Nothing to the right: the smallest circle, of radius 1, has to fit, or a larger one that leans to the left.
        assert!(loaded_below(1.0).proves(p, q, far_left, None));
        assert!(loaded_below(0.3).proves(p, q, far_left, None));
        assert!(!loaded_below(0.1).proves(p, q, far_left, None));
        // A near corner to the left leaves only circles that lean to the right.
        assert!(!loaded_below(1.0).proves(p, q, Some([-0.5, 0.0]), None));
        assert!(loaded_below(2.1).proves(p, q, Some([-0.5, 0.0]), None));
        assert!(loaded_below(f64::INFINITY).proves(p, q, Some([-0.5, 0.0]), None));
    }

    #[test]
    fn a_circle_that_touches_the_border_is_not_inside() {
        let circle = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]];
        let touching = 5.0 + 50f64.sqrt();
        assert!(!loaded_below(touching).holds_circle(&circle));
        assert!(loaded_below(touching + 1e-9).holds_circle(&circle));
        assert!(!loaded_below(1e300).holds_circle(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), "no circle");
    }
}
