//! What stands upright beside roads and lines: lamp posts, signs, wooden poles and lattice pylons, and the wires they carry.

use super::geometry::{Placement, Vector, between};
use super::panel::Panel;
use super::rod::{Rod, Wire};
use super::shape::{Kind, Object, Part, Shape};

const STEEL_REFLECTANCE: f64 = 0.35;
const WIRE_REFLECTANCE: f64 = 0.4;

fn rod(placement: &Placement, start: Vector, end: Vector, radius: f64) -> Shape {
    Shape::Rod(Rod { start: placement.place(start), end: placement.place(end), radius })
}

/// A lamp post whose arm reaches out along local x.
pub(super) fn lamp_post(placement: &Placement, height: f64) -> Object {
    let shapes = vec![
        rod(placement, [0.0, 0.0, -0.3], [0.0, 0.0, height], 0.075),
        rod(placement, [0.0, 0.0, height], [1.4, 0.0, height + 0.25], 0.04),
        rod(placement, [1.3, 0.0, height + 0.22], [1.9, 0.0, height + 0.28], 0.11),
    ];
    Object::of(Kind::Pole, STEEL_REFLECTANCE, placement.origin[2], shapes)
}

/// A road sign that faces along local x.
pub(super) fn sign(placement: &Placement) -> Object {
    let post = rod(placement, [0.0, 0.0, -0.3], [0.0, 0.0, 2.8], 0.03);
    let corners = [[0.04, -0.32, 2.15], [0.04, 0.32, 2.15], [0.04, 0.32, 2.79], [0.04, -0.32, 2.79]];
    let face = Shape::Panel(Box::new(Panel::new(corners.map(|corner| placement.place(corner)), [true; 4])));
    let mut object = Object::of(Kind::Pole, STEEL_REFLECTANCE, placement.origin[2], vec![post]);
    object.parts.push(Part { shape: face, kind: Kind::Pole, reflectance: 0.95 });
    object
}

/// A support of wires; the line runs along local x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Support {
    /// A wooden pole with one short crossarm.
    Pole,
    /// A lattice pylon with one long crossarm and an earth wire at the top.
    Pylon,
}

impl Support {
    /// Where the wires are fastened, in local coordinates.
    pub(super) const fn fastenings(self) -> &'static [Vector] {
        match self {
            Self::Pole => &[[0.0, -0.85, 8.15], [0.0, 0.0, 8.35], [0.0, 0.85, 8.15]],
            Self::Pylon => &[[0.0, -5.2, 18.2], [0.0, 0.0, 21.2], [0.0, 5.2, 18.2], [0.0, 0.0, 26.0]],
        }
    }

    /// The support as an object; the origin of `placement` is the ground at its foot.
    pub(super) fn build(self, placement: &Placement) -> Object {
        let shapes = match self {
            Self::Pole => vec![
                rod(placement, [0.0, 0.0, -0.5], [0.0, 0.0, 8.2], 0.13),
                rod(placement, [0.1, -0.95, 7.95], [0.1, 0.95, 7.95], 0.06),
            ],
            Self::Pylon => pylon(placement),
        };
        Object::of(Kind::Tower, STEEL_REFLECTANCE, placement.origin[2], shapes)
    }
}

/// Four legs that lean together, crossed braces on each face, a crossarm of two triangles.
fn pylon(placement: &Placement) -> Vec<Shape> {
    const TOP: f64 = 26.0;
    const FEET: [(f64, f64); 4] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    // Heights at which the braces meet the legs, closer together towards the top.
    const LEVELS: [f64; 7] = [0.0, 6.0, 11.0, 15.0, 18.5, 21.5, 24.5];
    let on_leg = |leg: usize, height: f64| {
        let half = 2.1 + (0.25 - 2.1) * height / TOP;
        [FEET[leg % 4].0 * half, FEET[leg % 4].1 * half, height]
    };
    let mut shapes = Vec::new();
    for leg in 0..4 {
        shapes.push(rod(placement, on_leg(leg, -0.5), on_leg(leg, TOP), 0.08));
        for level in LEVELS.windows(2) {
            shapes.push(rod(placement, on_leg(leg, level[0]), on_leg(leg + 1, level[1]), 0.035));
            shapes.push(rod(placement, on_leg(leg + 1, level[0]), on_leg(leg, level[1]), 0.035));
        }
    }
    for side in [-1.0, 1.0] {
        let tip = [0.0, side * 5.2, 18.7];
        for x in [-0.8, 0.8] {
            shapes.push(rod(placement, [x, 0.0, 18.5], tip, 0.05));
        }
        shapes.push(rod(placement, [0.0, 0.0, 20.6], tip, 0.04));
        let brace = between([0.0, 0.0, 20.6], tip, 0.5);
        shapes.push(rod(placement, brace, [0.0, brace[1], 18.6], 0.035));
        // The insulator hangs from the tip.
        shapes.push(rod(placement, [0.0, side * 5.2, 18.2], tip, 0.06));
    }
    shapes
}

/// A span of wire as an object.
pub(super) fn wire_span(start: Vector, end: Vector, sag: f64, radius: f64) -> Object {
    let wire = Wire { start, end, sag, radius };
    Object::of(Kind::Wire, WIRE_REFLECTANCE, start[2].min(end[2]), vec![Shape::Wire(wire)])
}
