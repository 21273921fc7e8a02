//! What a mobile scanner drives through: a street between two rows of houses, with parked cars, trees, lamps and wires.
//!
//! The cross-section is that of a small town: a carriageway of 10 m with a parking lane on either side, kerbs of 12 cm,
//! pavements of 3 m, facades, yards behind. Measures and places are drawn from a hash of the seed and the block.

use super::car::Car;
use super::geometry::{Placement, Ray};
use super::house::House;
use super::mast::{Support, lamp_post, sign, wire_span};
use super::random::{Random, hash};
use super::shape::{Kind, Object};
use super::terrain::{Noise, meet};
use super::tree::{Tree, bush};
use super::world::{BLOCK, Layout, start_of};

/// From the middle of the street to the kerb, metres.
pub(super) const HALF_CARRIAGEWAY: f64 = 5.0;
/// From the middle of the street to the facades, metres.
const HALF_STREET: f64 = 8.0;
/// Height of the kerb, metres.
const KERB: f64 = 0.12;
/// Fall of carriageway and pavement towards the gutter, metres per metre.
const CROSSFALL: f64 = 0.02;
/// From one utility pole to the next, metres.
const POLE_SPACING: f64 = 32.0;
/// Where the utility poles stand, metres to the left of the middle.
const POLE_LINE: f64 = -5.7;
/// From one parking space to the next, metres.
const PARKING: f64 = 6.4;

/// The street of one seed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Street {
    seed: u64,
    meander: Noise,
    profile: Noise,
    yards: Noise,
}

impl Street {
    /// The street of a seed.
    pub(super) const fn new(seed: u64) -> Self {
        let (meander, profile, yards) = (hash(seed, 5, -1), hash(seed, 6, -1), hash(seed, 7, -1));
        Self { seed, meander: Noise::new(meander), profile: Noise::new(profile), yards: Noise::new(yards) }
    }

    /// Where the middle of the street runs, metres to the left of the track.
    pub(super) fn middle(&self, x: f64) -> f64 {
        4.0 * self.meander.along(x / 240.0)
    }

    /// The street `lateral` metres to the left of its middle, facing along it.
    pub(super) fn beside(&self, x: f64, lateral: f64) -> Placement {
        let slope = (self.middle(x + 1.0) - self.middle(x - 1.0)) / 2.0;
        let length = (1.0 + slope * slope).sqrt();
        let forward = [1.0 / length, slope / length];
        let (x, y) = (x - lateral * forward[1], self.middle(x) + lateral * forward[0]);
        let height = if lateral.abs() < HALF_CARRIAGEWAY { self.carriageway(x, y) } else { self.pavement(x, y) };
        Placement { origin: [x, y, height], forward }
    }

    /// Height of the middle of the street, metres.
    fn level(&self, x: f64) -> f64 {
        110.0 + 2.5 * self.profile.along(x / 210.0) + 0.04 * self.profile.along(1e5 + x / 17.0)
    }

    /// Height of the carriageway, continued beyond the kerbs, metres.
    fn carriageway(&self, x: f64, y: f64) -> f64 {
        self.level(x) - CROSSFALL * (y - self.middle(x)).abs()
    }

    /// Height of pavements and yards, continued between the kerbs, metres.
    fn pavement(&self, x: f64, y: f64) -> f64 {
        let lateral = (y - self.middle(x)).abs();
        let slab = self.level(x) - CROSSFALL * HALF_CARRIAGEWAY + KERB;
        let yard = (lateral - HALF_STREET).clamp(0.0, 4.0) / 4.0;
        let rise = CROSSFALL * (lateral - HALF_CARRIAGEWAY).min(HALF_STREET - HALF_CARRIAGEWAY);
        slab + rise + if yard > 0.0 { 0.25 * yard * self.yards.at(x / 9.0, y / 9.0) } else { 0.0 }
    }

    /// Where a ray from above the carriageway meets the ground within `reach`, in metres, and what it finds there.
    ///
    /// The ground is three smooth surfaces: the ray leaves the carriageway at a kerb or not at all.
    pub(super) fn strike(&self, ray: &Ray, guess: f64, reach: f64) -> Option<(f64, Kind)> {
        if ray.direction[2] > -0.01 {
            return None;
        }
        let road = || meet(|x, y| self.carriageway(x, y), ray, guess, reach).map(|distance| (distance, Kind::Road));
        let Some(edge) = self.leave_carriageway(ray).filter(|edge| *edge < reach) else {
            return road();
        };
        let [x, y, z] = ray.at(edge);
        if z < self.carriageway(x, y) {
            return road();
        }
        if z < self.pavement(x, y) {
            return Some((edge, Kind::Ground)); // the face of the kerb
        }
        meet(|x, y| self.pavement(x, y), ray, guess.max(edge), reach).map(|distance| (distance, Kind::Ground))
    }

    /// Distance at which a ray passes over a kerb, metres.
    fn leave_carriageway(&self, ray: &Ray) -> Option<f64> {
        let across = ray.direction[1];
        if across.abs() < 0.02 {
            return None;
        }
        let kerb = HALF_CARRIAGEWAY.copysign(across);
        let mut distance = 0.0;
        // The street hardly bends: three steps bring the crossing to within a millimetre.
        for _ in 0..3 {
            let x = ray.origin[0] + distance * ray.direction[0];
            distance = (self.middle(x) + kerb - ray.origin[1]) / across;
        }
        (distance > 0.0).then_some(distance)
    }

    /// One row of houses: most touch their neighbours, between some there is a yard.
    fn build_row(&self, block: i64, side: f64, random: &mut Random, objects: &mut Vec<Object>) {
        const FRONTAGES: u32 = 9;
        let frontage = BLOCK / f64::from(FRONTAGES);
        for number in 0..FRONTAGES {
            let middle = start_of(block) + (f64::from(number) + 0.5) * frontage;
            if random.chance(0.14) {
                self.plant_yard(middle, side, random, objects);
                continue;
            }
            let gap = if random.chance(0.3) { random.between(1.5, 3.5) } else { 0.0 };
            let width = random.between(9.0, 11.0);
            let storeys = 2.0 + (2.6 * random.unit()).floor();
            let house = House {
                length: frontage - gap,
                width,
                wall_height: 3.0 * storeys + random.between(0.5, 1.2),
                pitch: random.between(0.7, 1.1),
                overhang: 0.35,
                is_hipped: false,
                has_garage: false,
                has_windows: true,
            };
            let setback = HALF_STREET + random.between(0.0, 0.25) + width / 2.0;
            objects.push(house.build(&self.beside(middle, side * setback)));
        }
    }

    /// A gap in the row: a hedge along the pavement and a tree behind it.
    fn plant_yard(&self, middle: f64, side: f64, random: &mut Random, objects: &mut Vec<Object>) {
        for number in 0..5 {
            let foot = self.beside(middle + f64::from(number - 2) * 1.7, side * (HALF_STREET + 0.9)).origin;
            objects.push(bush(foot, random.between(0.6, 0.85), random.between(1.0, 1.5)));
        }
        let tree = Tree {
            height: random.between(7.0, 11.0),
            crown_radius: 2.8,
            clear_trunk: 2.2,
            is_conifer: random.chance(0.3),
        };
        let foot = self.beside(middle + random.between(-2.0, 2.0), side * (HALF_STREET + 6.0)).origin;
        objects.push(tree.build(foot, random));
    }

    /// Cars in both parking lanes, trees, signs and lamps on the pavements.
    fn furnish(&self, block: i64, random: &mut Random, objects: &mut Vec<Object>) {
        for number in 0..20 {
            let x = start_of(block) + (f64::from(number) + 0.5) * PARKING;
            for side in [-1.0, 1.0] {
                if random.chance(0.5) {
                    let mut space = self.beside(x + random.between(-0.4, 0.4), side * (HALF_CARRIAGEWAY - 1.05));
                    space.forward = space.forward.map(|component| -side * component);
                    objects.push(Car::draw(random).build(&space, random.between(0.1, 0.85)));
                }
            }
        }
        for number in 0..8 {
            let x = start_of(block) + 16.0 * f64::from(number) + 5.0;
            for side in [-1.0, 1.0] {
                if random.chance(0.62) {
                    let crown_radius = random.between(1.3, 1.75);
                    let clear_trunk = random.between(2.4, 3.2);
                    let tree = Tree { height: random.between(5.5, 8.0), crown_radius, clear_trunk, is_conifer: false };
                    let foot = self.beside(x + random.between(-1.5, 1.5), side * (HALF_CARRIAGEWAY + 1.1)).origin;
                    objects.push(tree.build(foot, random));
                } else if random.chance(0.4) {
                    let mut place = self.beside(x, side * (HALF_CARRIAGEWAY + 0.5));
                    place.forward = place.forward.map(|component| side * component);
                    objects.push(sign(&place));
                }
            }
            if number % 2 == 1 {
                let post = self.beside(x + 8.0, HALF_CARRIAGEWAY + 0.6).quarter_turned();
                let towards_road = Placement { forward: post.forward.map(|component| -component), ..post };
                objects.push(lamp_post(&towards_road, 7.0));
            }
        }
    }

    /// Utility poles with three wires from each to the next and one across the street to a house.
    fn string_wires(&self, block: i64, random: &mut Random, objects: &mut Vec<Object>) {
        for number in 0..4 {
            let x = start_of(block) + (f64::from(number) + 0.4) * POLE_SPACING;
            let (here, there) = (self.beside(x, POLE_LINE), self.beside(x + POLE_SPACING, POLE_LINE));
            objects.push(Support::Pole.build(&here));
            for &fastening in Support::Pole.fastenings() {
                let sag = random.between(0.45, 0.6);
                objects.push(wire_span(here.place(fastening), there.place(fastening), sag, 0.008));
            }
            let house = self.beside(x + random.between(-6.0, 6.0), HALF_STREET + 0.3);
            objects.push(wire_span(here.place([0.0, 0.0, 7.6]), house.place([0.0, 0.0, 6.2]), 0.3, 0.008));
        }
    }
}

impl Layout for Street {
    fn objects(&self, block: i64) -> Vec<Object> {
        let mut objects = Vec::new();
        if block >= 0 {
            let mut random = Random::at(self.seed, block, 0);
            self.build_row(block, -1.0, &mut random, &mut objects);
            self.build_row(block, 1.0, &mut random, &mut objects);
            self.furnish(block, &mut random, &mut objects);
            self.string_wires(block, &mut random, &mut objects);
        }
        objects
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::unit;

    #[test]
    fn a_kerb_is_met_on_its_face() {
        let street = Street::new(2);
        let van = street.beside(50.0, -1.7).origin;
        let mut surfaces = [0, 0, 0]; // road, kerb face, pavement
        for step in 0..2000 {
            let direction = unit([0.0, -1.0, -0.75 + f64::from(step) * 1e-4]);
            let ray = Ray { origin: [van[0], van[1], van[2] + 2.3], direction, aperture: 0.0, spread: 0.0 };
            let (distance, kind) = street.strike(&ray, 3.0, 80.0).expect("the ground is near");
            let [x, y, z] = ray.at(distance);
            let lateral = street.middle(x) - y;
            match kind {
                Kind::Road => surfaces[0] += 1,
                _ if (lateral - HALF_CARRIAGEWAY).abs() < 1e-3 => {
                    surfaces[1] += 1;
                    assert!(z >= street.carriageway(x, y) - 1e-3 && z <= street.pavement(x, y) + 1e-3);
                }
                _ => surfaces[2] += 1,
            }
            let beyond = lateral - HALF_CARRIAGEWAY;
            assert!(
                if kind == Kind::Road { beyond < 1e-3 } else { beyond > -1e-3 },
                "{kind:?} {beyond} m beyond the kerb"
            );
        }
        assert!(surfaces.iter().all(|count| *count > 20), "{surfaces:?}");
    }
}
