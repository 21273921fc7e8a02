//! Cars: a side view drawn out across, narrower towards the roof, on four wheels.

use super::geometry::{Placement, Vector};
use super::panel::Panel;
use super::random::Random;
use super::rod::Rod;
use super::shape::{Kind, Object, Part, Shape};

const GLASS_REFLECTANCE: f64 = 0.12;
const TYRE_REFLECTANCE: f64 = 0.06;

/// A kind of car by its side view.
///
/// The outline goes from the lower front edge over the roof to the lower rear edge: distance from the front, height above
/// the ground and half width, metres. Points 2 to 5 are the foot and head of the windscreen and of the rear window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Car {
    outline: [[f64; 3]; 8],
}

impl Car {
    /// A car of a random kind.
    pub(super) fn draw(random: &mut Random) -> Self {
        match random.unit() {
            share if share < 0.4 => Self::SALOON,
            share if share < 0.85 => Self::HATCHBACK,
            _ => Self::VAN,
        }
    }

    const SALOON: Self = Self {
        outline: [
            [0.0, 0.25, 0.85],
            [0.05, 0.72, 0.85],
            [1.25, 0.95, 0.88],
            [2.0, 1.43, 0.64],
            [3.2, 1.44, 0.64],
            [3.95, 1.02, 0.86],
            [4.55, 0.95, 0.84],
            [4.6, 0.28, 0.84],
        ],
    };
    const HATCHBACK: Self = Self {
        outline: [
            [0.0, 0.25, 0.84],
            [0.05, 0.75, 0.84],
            [1.0, 0.98, 0.87],
            [1.75, 1.5, 0.66],
            [3.45, 1.5, 0.66],
            [3.95, 1.02, 0.86],
            [4.05, 0.9, 0.84],
            [4.1, 0.28, 0.84],
        ],
    };
    const VAN: Self = Self {
        outline: [
            [0.0, 0.28, 0.95],
            [0.05, 0.95, 0.95],
            [0.65, 1.15, 0.97],
            [1.4, 1.98, 0.84],
            [5.0, 2.02, 0.84],
            [5.15, 1.15, 0.96],
            [5.2, 0.9, 0.96],
            [5.2, 0.3, 0.96],
        ],
    };

    /// From bumper to bumper, metres.
    pub(super) const fn length(&self) -> f64 {
        self.outline[7][0]
    }

    /// The car as an object; the origin of `placement` is the ground below its middle, local x its front.
    pub(super) fn build(&self, placement: &Placement, paint: f64) -> Object {
        let mut parts = Vec::new();
        let mut skin = |reflectance: f64, corners: [Vector; 4]| {
            let panel = Panel::new(corners.map(|corner| placement.place(corner)), [false; 4]);
            parts.push(Part { shape: Shape::Panel(Box::new(panel)), kind: Kind::Car, reflectance });
        };
        for (number, pair) in self.outline.windows(2).enumerate() {
            let [front, rear] = [pair[0], pair[1]];
            let is_glass = number == 2 || number == 4;
            let corners = [self.at(front, 1.0), self.at(front, -1.0), self.at(rear, -1.0), self.at(rear, 1.0)];
            skin(if is_glass { GLASS_REFLECTANCE } else { paint }, corners);
        }
        for side in [-1.0, 1.0] {
            let corner = |number: usize| self.at(self.outline[number], side);
            // Below the windows in three pieces, from the front to the rear, and the cabin on top of the middle one.
            let sill = |number: usize| self.at([self.outline[number][0], 0.26, self.outline[number][2]], side);
            skin(paint, [corner(0), corner(1), corner(2), sill(2)]);
            skin(paint, [sill(2), corner(2), corner(5), sill(5)]);
            skin(paint, [sill(5), corner(5), corner(6), corner(7)]);
            skin(GLASS_REFLECTANCE, [corner(2), corner(3), corner(4), corner(5)]);
        }
        parts.extend(self.wheels(placement));
        Object { parts, ground: placement.origin[2] }
    }

    /// An outline point in local coordinates, on one side of the car.
    fn at(&self, [from_front, height, half_width]: [f64; 3], side: f64) -> Vector {
        [self.length() / 2.0 - from_front, side * half_width, height]
    }

    fn wheels(&self, placement: &Placement) -> Vec<Part> {
        let (front, rear) = (self.length() * 0.5 - 0.8, -self.length() * 0.5 + 0.85);
        let places = [(front, -0.52), (front, 0.52), (rear, -0.52), (rear, 0.52)];
        let wheel = |(x, y): (f64, f64)| {
            let (start, end) = (placement.place([x, y - 0.05, 0.31]), placement.place([x, y + 0.05, 0.31]));
            Part { shape: Shape::Rod(Rod { start, end, radius: 0.3 }), kind: Kind::Car, reflectance: TYRE_REFLECTANCE }
        };
        places.into_iter().map(wheel).collect()
    }
}
