//! What an airborne scanner flies over: villages along a road, open country with groves between them, a power line.
//!
//! Five blocks make a cycle: three of village, two of open country. Everything stands on [`Terrain`]; measures and places
//! are drawn from a hash of the seed and the number of the block.

use super::car::Car;
use super::geometry::{Placement, Vector};
use super::house::House;
use super::mast::{Support, lamp_post, wire_span};
use super::random::{Random, hash};
use super::shape::{Kind, Object};
use super::terrain::{Noise, Terrain};
use super::tree::{Tree, bush};
use super::world::{BLOCK, Layout, block_at, start_of};

/// Blocks of a village and the country after it.
const CYCLE: i64 = 5;
/// The first so many of them are village.
const VILLAGE_BLOCKS: i64 = 3;
/// Half the width of the carriageway, metres.
const HALF_ROAD: f64 = 2.9;
/// How far the back lane of a village runs to the left of the main road, metres.
const BACK_LANE: f64 = 62.0;
/// Frontage of a plot, metres.
const PLOT: f64 = BLOCK / 6.0;
/// From the middle of the road to the middle of a house, metres.
const SETBACK: f64 = 14.5;
/// Where the power line runs, metres to the left of the track.
const POWER_LINE: f64 = -76.0;
/// Nothing tall grows this close to the power line, metres.
const CLEARING: f64 = 11.0;

/// The landscape of one seed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Village {
    seed: u64,
    terrain: Terrain,
    meander: Noise,
    woods: Noise,
}

/// A circle that trees stay out of: middle and radius, metres.
type Clear = (f64, f64, f64);

impl Village {
    /// The landscape of a seed.
    pub(super) const fn new(seed: u64) -> Self {
        let (terrain, meander, woods) = (hash(seed, 1, -1), hash(seed, 2, -1), hash(seed, 3, -1));
        Self { seed, terrain: Terrain::new(terrain), meander: Noise::new(meander), woods: Noise::new(woods) }
    }

    /// Height of the ground, metres.
    pub(super) fn ground(&self, x: f64, y: f64) -> f64 {
        self.terrain.height(x, y)
    }

    /// Carriageway or open ground.
    pub(super) fn surface(&self, x: f64, y: f64) -> Kind {
        let lateral = y - self.road(x);
        let is_on_lane = is_village(block_at(x)) && (lateral - BACK_LANE).abs() < HALF_ROAD;
        if lateral.abs() < HALF_ROAD || is_on_lane { Kind::Road } else { Kind::Ground }
    }

    /// How wooded a place is, −1 to 1.
    fn wood(&self, x: f64, y: f64) -> f64 {
        let (along, across) = (0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y);
        0.72 * self.woods.at(along / 52.0, across / 52.0) + 0.28 * self.woods.at(1e4 + along / 13.0, across / 13.0)
    }

    /// Where the middle of the road runs, metres to the left of the track.
    fn road(&self, x: f64) -> f64 {
        9.0 * self.meander.along(x / 260.0)
    }

    /// The ground beside the road, `lateral` metres to its left, facing along it.
    fn beside(&self, x: f64, lateral: f64) -> Placement {
        let slope = (self.road(x + 1.0) - self.road(x - 1.0)) / 2.0;
        let length = (1.0 + slope * slope).sqrt();
        let y = self.road(x) + lateral;
        Placement { origin: [x, y, self.ground(x, y)], forward: [1.0 / length, slope / length] }
    }

    /// Houses with their gardens along both sides of the road and the lane.
    fn settle(&self, block: i64, random: &mut Random, objects: &mut Vec<Object>, clear: &mut Vec<Clear>) {
        for plot in 0..6 {
            let middle = start_of(block) + (f64::from(plot) + 0.5) * PLOT;
            for (lane, side) in [(0.0, -1.0), (0.0, 1.0), (BACK_LANE, -1.0), (BACK_LANE, 1.0)] {
                if random.chance(0.1) {
                    continue;
                }
                let x = middle + random.between(-2.0, 2.0);
                let mut placement = self.beside(x, lane + side * (SETBACK + random.between(-1.5, 2.0)));
                if random.chance(0.4) {
                    placement = placement.quarter_turned();
                }
                placement = placement.turned(random.between(-0.07, 0.07));
                objects.push(draw_house(random).build(&placement));
                clear.push((placement.origin[0], placement.origin[1], 9.0));
                self.plant_garden(middle, lane, side, random, objects);
            }
        }
    }

    /// Trees behind the house, bushes at the fence, perhaps a car beside the house.
    fn plant_garden(&self, middle: f64, lane: f64, side: f64, random: &mut Random, objects: &mut Vec<Object>) {
        let spot = |reach: f64, from: f64, to: f64, random: &mut Random| {
            self.beside(middle + random.between(-reach, reach), lane + side * random.between(from, to))
        };
        for _ in 0..3 {
            if random.chance(0.6) {
                let foot = spot(8.5, 24.0, 30.0, random).origin;
                let size = random.between(0.35, 0.8);
                objects.push(draw_tree(random, size).build(foot, random));
            }
        }
        for _ in 0..4 {
            let foot = spot(9.5, 5.2, 6.5, random).origin;
            objects.push(bush(foot, random.between(0.5, 1.1), random.between(0.7, 1.9)));
        }
        if random.chance(0.55) {
            let mut drive = self.beside(middle - 9.0, lane + side * random.between(8.5, 10.5)).quarter_turned();
            drive.forward = drive.forward.map(|component| component * side);
            objects.push(Car::draw(random).build(&drive, random.between(0.15, 0.8)));
        }
    }

    /// Lamp posts and cars along the main road.
    fn furnish_road(&self, block: i64, random: &mut Random, objects: &mut Vec<Object>) {
        for number in 0..4 {
            let x = start_of(block) + 16.0 + 32.0 * f64::from(number);
            let post = self.beside(x, 4.0).quarter_turned();
            let towards_road = Placement { forward: post.forward.map(|component| -component), ..post };
            objects.push(lamp_post(&towards_road, 6.5));
            for side in [-1.0, 1.0] {
                if random.chance(0.3) {
                    let mut car = self.beside(x + random.between(6.0, 26.0), side * 1.7);
                    car.forward = car.forward.map(|component| -side * component);
                    objects.push(Car::draw(random).build(&car, random.between(0.15, 0.8)));
                }
            }
        }
    }

    /// Where the pylon of a block stands; the line runs along its local x.
    fn pylon(&self, block: i64) -> Placement {
        let foot = |number: i64| {
            let mut random = Random::at(self.seed, number, 1);
            let x = start_of(number) + random.between(40.0, 80.0);
            [x, POWER_LINE + random.between(-3.0, 3.0)]
        };
        let ([x, y], before, after) = (foot(block), foot(block - 1), foot(block + 1));
        let (run, rise) = (after[0] - before[0], after[1] - before[1]);
        let length = (run * run + rise * rise).sqrt();
        Placement { origin: [x, y, self.ground(x, y)], forward: [run / length, rise / length] }
    }

    /// The pylon of a block and the wires to the next.
    fn string_power_line(&self, block: i64, random: &mut Random, objects: &mut Vec<Object>) {
        let (here, there) = (self.pylon(block), self.pylon(block + 1));
        objects.push(Support::Pylon.build(&here));
        let sag = random.between(2.6, 3.2);
        for &fastening in Support::Pylon.fastenings() {
            objects.push(wire_span(here.place(fastening), there.place(fastening), sag, 0.02));
        }
    }

    /// Groves where the noise is high, out of the way of everything else.
    fn plant_woods(&self, block: i64, random: &mut Random, objects: &mut Vec<Object>, clear: &[Clear]) {
        const GRID: f64 = 5.4;
        let (needed, reach) = if is_village(block) { (0.3, BACK_LANE + 24.0) } else { (0.12, 0.0) };
        for column in 0..23 {
            for row in -22..22 {
                let x = start_of(block) + (f64::from(column) + random.unit()) * GRID;
                let y = (f64::from(row) + random.unit()) * GRID;
                let lateral = y - self.road(x);
                let is_in_settlement = is_village(block) && (-24.0..reach).contains(&lateral);
                let is_free = lateral.abs() > HALF_ROAD + 4.5
                    && (y - POWER_LINE).abs() > CLEARING
                    && clear.iter().all(|(at_x, at_y, radius)| (at_x - x).abs().max((at_y - y).abs()) > *radius);
                let wood = self.wood(x, y);
                if is_free && !is_in_settlement && wood > needed {
                    let foot: Vector = [x, y, self.ground(x, y)];
                    let is_margin = wood < needed + 0.08;
                    if is_margin && random.chance(0.6) {
                        objects.push(bush(foot, random.between(0.8, 1.7), random.between(1.2, 3.4)));
                    } else {
                        objects.push(draw_tree(random, 1.0).build(foot, random));
                    }
                }
            }
        }
    }
}

impl Layout for Village {
    fn objects(&self, block: i64) -> Vec<Object> {
        let mut objects = Vec::new();
        if block < 0 {
            return objects;
        }
        let mut random = Random::at(self.seed, block, 0);
        let mut clear = Vec::new();
        self.string_power_line(block, &mut random, &mut objects);
        if is_village(block) {
            self.settle(block, &mut random, &mut objects, &mut clear);
        }
        self.furnish_road(block, &mut random, &mut objects);
        self.plant_woods(block, &mut random, &mut objects, &clear);
        objects
    }
}

const fn is_village(block: i64) -> bool {
    block.rem_euclid(CYCLE) < VILLAGE_BLOCKS
}

fn draw_house(random: &mut Random) -> House {
    let length = random.between(9.5, 12.5);
    let has_garage = random.chance(0.25);
    House {
        length: if has_garage { length.min(10.5) } else { length },
        width: random.between(7.5, 9.2),
        wall_height: if random.chance(0.5) { random.between(3.0, 3.8) } else { random.between(5.2, 6.2) },
        pitch: random.between(0.55, 1.1),
        overhang: random.between(0.35, 0.7),
        is_hipped: random.chance(0.3),
        has_garage,
        has_windows: false,
    }
}

/// A tree of a random kind; `size` is 1 for a grown tree of the woods.
fn draw_tree(random: &mut Random, size: f64) -> Tree {
    let is_conifer = random.chance(0.3);
    let height = size * random.between(10.0, 21.0);
    let slenderness = if is_conifer { random.between(0.13, 0.19) } else { random.between(0.19, 0.28) };
    let clear_trunk = height * if is_conifer { 0.1 } else { random.between(0.2, 0.35) };
    Tree { height, crown_radius: height * slenderness, clear_trunk, is_conifer }
}
