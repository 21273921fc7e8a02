//! Houses: walls, a gable or hip roof with eaves, a chimney, sometimes a flat garage, windows where a street passes.

use super::geometry::{Placement, Vector, scale, subtract, unit};
use super::panel::{Panel, Windows};
use super::shape::{Kind, Object, Part, Shape};

/// How far walls reach below the ground at the middle of the house, metres: houses stand on slopes.
const FOUNDATION: f64 = 2.5;
const WALL_REFLECTANCE: f64 = 0.45;
const ROOF_REFLECTANCE: f64 = 0.3;

/// Measures of a house, metres. The ridge runs along local x, the middle of the house is the local origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct House {
    /// Along the ridge.
    pub(super) length: f64,
    /// Across the ridge.
    pub(super) width: f64,
    /// From the ground to where the roof rests on the walls.
    pub(super) wall_height: f64,
    /// Rise of the roof per metre.
    pub(super) pitch: f64,
    /// How far the roof reaches beyond the walls.
    pub(super) overhang: f64,
    /// Four roof planes instead of two.
    pub(super) is_hipped: bool,
    /// A flat-roofed garage at the end of positive local x.
    pub(super) has_garage: bool,
    /// Rows and columns of windows in the long walls.
    pub(super) has_windows: bool,
}

impl House {
    /// The house as an object; the origin of `placement` is the ground at its middle.
    pub(super) fn build(&self, placement: &Placement) -> Object {
        let mut parts = Vec::new();
        let mut cover = |reflectance: f64, panels: Vec<Panel>| {
            parts.extend(panels.into_iter().map(|panel| Part {
                shape: Shape::Panel(Box::new(panel)),
                kind: Kind::Building,
                reflectance,
            }));
        };
        cover(WALL_REFLECTANCE, self.walls(placement));
        cover(ROOF_REFLECTANCE, if self.is_hipped { self.hip(placement) } else { self.gable(placement) });
        let ridge = self.wall_height + self.pitch * self.width / 2.0;
        let chimney = [self.length * 0.18, self.width * 0.12, 0.0];
        cover(WALL_REFLECTANCE, cuboid(placement, chimney, [0.7, 0.6], [self.wall_height, ridge + 0.7], false));
        if self.has_garage {
            let beside = [self.length / 2.0 + 1.7, -self.width * 0.15, 0.0];
            cover(WALL_REFLECTANCE, cuboid(placement, beside, [3.4, 6.0], [-FOUNDATION, 2.7], true));
        }
        Object { parts, ground: placement.origin[2] }
    }

    fn walls(&self, placement: &Placement) -> Vec<Panel> {
        let (end, side, top) = (self.length / 2.0, self.width / 2.0, self.wall_height);
        let mut walls = cuboid(placement, [0.0; 3], [self.length, self.width], [-FOUNDATION, top], false);
        walls.pop(); // the roof takes the place of the lid
        if self.has_windows {
            walls = walls
                .into_iter()
                .enumerate()
                .map(|(number, wall)| self.open_windows(placement, number, wall))
                .collect();
        }
        if !self.is_hipped {
            let ridge = top + self.pitch * side;
            for x in [-end, end] {
                let corners = [[x, -side, top], [x, side, top], [x, 0.0, ridge], [x, 0.0, ridge]];
                walls.push(Panel::new(corners.map(|corner| placement.place(corner)), [false; 4]));
            }
        }
        walls
    }

    /// Windows in walls 0 (negative y) and 2 (positive y), which run along the ridge.
    fn open_windows(&self, placement: &Placement, number: usize, wall: Panel) -> Panel {
        /// Height of a storey, metres.
        const STOREY: f64 = 3.0;
        let outward = match number {
            0 => -1.0,
            2 => 1.0,
            _ => return wall,
        };
        let columns = (self.length / 2.6).floor().max(1.0);
        let rows = (self.wall_height / STOREY).floor().max(1.0);
        let corner = [-self.length / 2.0, outward * self.width / 2.0, 0.25];
        let direction = |local: Vector| unit(subtract(placement.place(local), placement.place([0.0; 3])));
        wall.with_windows(Windows {
            origin: placement.place(corner),
            along: direction([1.0, 0.0, 0.0]),
            inward: scale(direction([0.0, 1.0, 0.0]), -outward),
            pitch: [self.length / columns, STOREY],
            size: [1.15, 1.5],
            count: [columns, rows],
            depth: 0.22,
        })
    }

    /// Two planes that meet in the ridge, free along eaves and verges.
    fn gable(&self, placement: &Placement) -> Vec<Panel> {
        let (end, side) = (self.length / 2.0 + self.overhang, self.width / 2.0 + self.overhang);
        let eave = self.wall_height - self.pitch * self.overhang;
        let ridge = self.wall_height + self.pitch * self.width / 2.0;
        let half = |y: f64| {
            let corners = [[-end, y, eave], [end, y, eave], [end, 0.0, ridge], [-end, 0.0, ridge]];
            Panel::new(corners.map(|corner| placement.place(corner)), [true, true, false, true])
        };
        vec![half(-side), half(side)]
    }

    /// Four planes of one pitch, free along the eaves.
    fn hip(&self, placement: &Placement) -> Vec<Panel> {
        let (end, side) = (self.length / 2.0 + self.overhang, self.width / 2.0 + self.overhang);
        let eave = self.wall_height - self.pitch * self.overhang;
        let ridge = eave + self.pitch * side.min(end);
        let tip = (end - side).max(0.0);
        let panel = |corners: [Vector; 4]| {
            Panel::new(corners.map(|corner| placement.place(corner)), [true, false, false, false])
        };
        let long = |y: f64| panel([[-end, y, eave], [end, y, eave], [tip, 0.0, ridge], [-tip, 0.0, ridge]]);
        let short = |sign: f64| {
            let top = [sign * tip, 0.0, ridge];
            panel([[sign * end, -side, eave], [sign * end, side, eave], top, top])
        };
        vec![long(-side), long(side), short(-1.0), short(1.0)]
    }
}

/// The sides and lid of a box around `middle`: `size` along local x and y, `levels` its lowest and highest z.
///
/// In order: the sides at negative y, positive x, positive y, negative x, and the lid, whose edges are free if asked for.
fn cuboid(placement: &Placement, middle: Vector, size: [f64; 2], levels: [f64; 2], has_free_lid: bool) -> Vec<Panel> {
    let [low, high] = levels;
    let corner =
        |x: f64, y: f64, z: f64| placement.place([middle[0] + x * size[0] / 2.0, middle[1] + y * size[1] / 2.0, z]);
    let around = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mut panels: Vec<Panel> = (0..4)
        .map(|number| {
            let ((x, y), (next_x, next_y)) = (around[number], around[(number + 1) % 4]);
            let corners =
                [corner(x, y, low), corner(next_x, next_y, low), corner(next_x, next_y, high), corner(x, y, high)];
            Panel::new(corners, [false; 4])
        })
        .collect();
    panels.push(Panel::new(around.map(|(x, y)| corner(x, y, high)), [has_free_lid; 4]));
    panels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::Ray;
    use crate::scene::random::Random;

    const COTTAGE: House = House {
        length: 11.0,
        width: 8.0,
        wall_height: 4.0,
        pitch: 0.8,
        overhang: 0.5,
        is_hipped: false,
        has_garage: true,
        has_windows: false,
    };

    #[test]
    fn no_pulse_from_above_gets_through_a_roof() {
        let placement = Placement { origin: [3.0, 4.0, 100.0], forward: [0.8, 0.6] };
        for is_hipped in [false, true] {
            let house = House { is_hipped, ..COTTAGE }.build(&placement);
            for step in 0..1600 {
                let local = [f64::from(step % 40) * 0.27 - 5.27, f64::from(step / 40) * 0.195 - 3.8, 50.0];
                let ray =
                    Ray { origin: placement.place(local), direction: [0.0, 0.0, -1.0], aperture: 0.1, spread: 0.0 };
                let mut hits = Vec::new();
                for part in &house.parts {
                    part.shape.hit(&ray, [0.0, 100.0], &mut Random::at(0, 0, 0), |hit| hits.push(hit));
                }
                assert!(hits.iter().any(|hit| hit.coverage > 0.999), "hipped {is_hipped}, local {local:?}");
            }
        }
    }

    #[test]
    fn a_house_is_as_large_as_its_measures() {
        let placement = Placement { origin: [0.0, 0.0, 100.0], forward: [1.0, 0.0] };
        let bounds = House { has_garage: false, ..COTTAGE }.build(&placement).bounds();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(close(bounds.high[0], 6.0) && close(bounds.low[1], -4.5), "{bounds:?}");
        assert!(close(bounds.high[2], 100.0 + 4.0 + 0.8 * 4.0 + 0.7), "{bounds:?}");
    }
}
