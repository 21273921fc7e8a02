//! Vectors, rays, boxes and placements: the little geometry that the shapes of a scene share.
//!
//! Everything is in metres, x along the track, y to its left, z up. Only the four basic operations and the square root
//! are used, which IEEE 754 rounds the same way everywhere.

/// A position or a direction, metres.
pub(super) type Vector = [f64; 3];

/// The sum of two vectors.
pub(super) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// The vector from `b` to `a`.
pub(super) fn subtract(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A vector `factor` times as long.
pub(super) fn scale(a: Vector, factor: f64) -> Vector {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// Inner product.
pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The direction of a vector; the null vector stays null.
pub(super) fn unit(a: Vector) -> Vector {
    let length = dot(a, a).sqrt();
    if length > 0.0 { scale(a, 1.0 / length) } else { a }
}

/// The point a `share` of the way from `a` to `b`.
pub(super) fn between(a: Vector, b: Vector, share: f64) -> Vector {
    add(a, scale(subtract(b, a), share))
}

/// A horizontal unit direction, from the tangent of half its angle to +x: a rational formula, no sine.
pub(super) fn heading(half_angle_tangent: f64) -> [f64; 2] {
    let square = half_angle_tangent * half_angle_tangent;
    [(1.0 - square) / (1.0 + square), 2.0 * half_angle_tangent / (1.0 + square)]
}

/// A laser pulse: a narrow cone around a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    /// Where the pulse leaves the scanner.
    pub(super) origin: Vector,
    /// Unit direction.
    pub(super) direction: Vector,
    /// Radius of the footprint at the scanner, metres.
    pub(super) aperture: f64,
    /// Growth of that radius, metres per metre.
    pub(super) spread: f64,
}

impl Ray {
    /// The point on the axis at a distance in metres.
    pub(super) fn at(&self, distance: f64) -> Vector {
        add(self.origin, scale(self.direction, distance))
    }

    /// Radius of the footprint at a distance, both in metres.
    pub(super) fn footprint(&self, distance: f64) -> f64 {
        self.aperture + self.spread * distance
    }
}

/// An axis-parallel box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bounds {
    /// Smallest coordinates.
    pub(super) low: Vector,
    /// Largest coordinates.
    pub(super) high: Vector,
}

impl Bounds {
    /// The box that holds nothing.
    pub(super) const EMPTY: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// The smallest box around some points.
    pub(super) fn around(points: &[Vector]) -> Self {
        let mut bounds = Self::EMPTY;
        for point in points {
            bounds = bounds.union(Self { low: *point, high: *point });
        }
        bounds
    }

    /// The smallest box around two boxes.
    pub(super) fn union(self, other: Self) -> Self {
        let mut joint = self;
        for axis in 0..3 {
            joint.low[axis] = joint.low[axis].min(other.low[axis]);
            joint.high[axis] = joint.high[axis].max(other.high[axis]);
        }
        joint
    }

    /// The box grown by `margin` metres on all six sides.
    pub(super) fn grown(self, margin: f64) -> Self {
        Self { low: add(self.low, [-margin; 3]), high: add(self.high, [margin; 3]) }
    }
}

/// Where an object stands and which way it faces: local x is `forward`, local y to its left, local z up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    /// The local origin.
    pub(super) origin: Vector,
    /// Horizontal unit direction of local x.
    pub(super) forward: [f64; 2],
}

impl Placement {
    /// A local point in scene coordinates.
    pub(super) fn place(&self, local: Vector) -> Vector {
        let [cosine, sine] = self.forward;
        let turned = [local[0] * cosine - local[1] * sine, local[0] * sine + local[1] * cosine, local[2]];
        add(self.origin, turned)
    }

    /// The same origin, turned to the left; the angle is given by the tangent of its half.
    pub(super) fn turned(&self, half_angle_tangent: f64) -> Self {
        let ([cosine, sine], [x, y]) = (heading(half_angle_tangent), self.forward);
        Self { origin: self.origin, forward: [x * cosine - y * sine, x * sine + y * cosine] }
    }

    /// The same origin, turned a quarter to the left.
    pub(super) fn quarter_turned(&self) -> Self {
        Self { origin: self.origin, forward: [-self.forward[1], self.forward[0]] }
    }
}
