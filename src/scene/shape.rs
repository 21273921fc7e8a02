//! What objects are made of: a few shapes, each of which knows its bounds and where a pulse meets it.

use super::crown::Crown;
use super::geometry::{Bounds, Ray, subtract};
use super::panel::Panel;
use super::random::Random;
use super::rod::{Rod, Wire};

/// What a piece of the scene is, as far as its points can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Open ground, pavements, kerbs.
    Ground,
    /// Carriageways.
    Road,
    /// Houses, garages, chimneys.
    Building,
    /// Trees and bushes.
    Vegetation,
    /// Spans of wire.
    Wire,
    /// What carries wires.
    Tower,
    /// Cars.
    Car,
    /// Lamp posts and signs.
    Pole,
}

/// The geometry of a part.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// A flat face.
    Panel(Box<Panel>),
    /// A straight bar.
    Rod(Rod),
    /// A hanging wire.
    Wire(Wire),
    /// A cloud of leaves.
    Crown(Crown),
}

/// A piece of an object: one shape of one material.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Its geometry.
    pub(super) shape: Shape,
    /// What it is.
    pub(super) kind: Kind,
    /// Share of the light that it throws back.
    pub(super) reflectance: f64,
}

/// An object: what one `object_id` stands for.
#[derive(Clone, Debug)]
pub(super) struct Object {
    /// Its pieces.
    pub(super) parts: Vec<Part>,
    /// Height of the ground where it stands, metres.
    pub(super) ground: f64,
}

/// A pulse meets a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// From the scanner, metres.
    pub(super) distance: f64,
    /// Share of what is left of the pulse that the surface intercepts.
    pub(super) coverage: f64,
    /// Of the angle of incidence.
    pub(super) cosine: f64,
    /// Factor on the reflectance of the part.
    pub(super) brightness: f64,
    /// Number of the part in its block.
    pub(super) part: usize,
}

impl Shape {
    /// The smallest box around the shape.
    pub(super) fn bounds(&self) -> Bounds {
        match self {
            Self::Panel(panel) => panel.bounds(),
            Self::Rod(rod) => rod.bounds(),
            Self::Wire(wire) => wire.bounds(),
            Self::Crown(crown) => crown.bounds(),
        }
    }

    /// Boxes that together hold the shape: several small ones for a wire, whose own box is mostly empty.
    pub(super) fn pieces(&self) -> Vec<Bounds> {
        /// Length of wire in one box, metres.
        const PIECE: f64 = 3.0;
        let Self::Wire(wire) = self else {
            return vec![self.bounds()];
        };
        let span = subtract(wire.end, wire.start);
        let pieces = ((span[0].abs() + span[1].abs()) / PIECE).ceil().max(1.0);
        let last = pieces as u32;
        let cut = |number: u32| wire.at(f64::from(number) / pieces);
        // Between two cuts the wire hangs a little below their chord: far less than the margin.
        (0..last).map(|number| Bounds::around(&[cut(number), cut(number + 1)]).grown(wire.radius + 0.05)).collect()
    }

    /// Adds where a ray meets the shape between the two distances.
    pub(super) fn hit(&self, ray: &Ray, [from, to]: [f64; 2], random: &mut Random, mut found: impl FnMut(Hit)) {
        let hit = match self {
            Self::Panel(panel) => panel.hit(ray, from, to),
            Self::Rod(rod) => rod.hit(ray, from, to),
            Self::Wire(wire) => wire.hit(ray, from, to),
            Self::Crown(crown) => return crown.hit(ray, from, to, random, found),
        };
        if let Some(hit) = hit {
            found(hit);
        }
    }
}

impl Object {
    /// An object of one material.
    pub(super) fn of(kind: Kind, reflectance: f64, ground: f64, shapes: Vec<Shape>) -> Self {
        let parts = shapes.into_iter().map(|shape| Part { shape, kind, reflectance }).collect();
        Self { parts, ground }
    }

    /// The smallest box around the object.
    #[cfg(test)]
    pub(super) fn bounds(&self) -> Bounds {
        self.parts.iter().fold(Bounds::EMPTY, |bounds, part| bounds.union(part.shape.bounds()))
    }
}
