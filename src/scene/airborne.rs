//! An airborne scanner: an oscillating mirror sweeps the beam across the track, a zig-zag on the ground.
//!
//! Flying 300 m above mean ground at 55 m/s with 90 000 pulses and 160 sweeps a second over a swath of 200 m: about 8
//! pulses per square metre, denser at the edges of the swath, where the mirror turns. The footprint is 0.2 m wide, so roof
//! edges, wires and leaves return only part of a pulse and the rest goes on.

use super::classification as class;
use super::geometry::{Ray, unit};
use super::pulse::{Echo, Moment, Receiver};
use super::random::{Random, hash};
use super::shape::{Hit, Kind};
use super::terrain::{Noise, meet};
use super::village::Village;
use super::world::World;
use super::{FIRST_GPS_TIME, ScenePoint};

/// Height of the track above the vertical datum, metres: 300 m above mean ground.
const ALTITUDE: f64 = 550.0;
/// Metres per second.
const SPEED: f64 = 55.0;
/// Per second.
const PULSES: f64 = 90_000.0;
/// Sweeps to one side, per second.
const SWEEPS: f64 = 160.0;
/// Tangent of half the scan angle.
const HALF_SCAN: f64 = 100.0 / 300.0;
/// Tangent of the angle by which the scan plane looks ahead, so that walls across the track are seen.
const LOOK_AHEAD: f64 = 0.06;
/// Standard deviation of the pointing, as a tangent: 2 cm on the ground.
const POINTING_NOISE: f64 = 7e-5;
/// Probability that a pulse meets a bird, and that its last echo took a detour.
const BIRDS: f64 = 2.5e-5;
const MULTIPATH: f64 = 2.0e-5;

const RECEIVER: Receiver = Receiver { range_noise: 0.02, resolution: 0.9, threshold: 0.012, most_returns: 5 };

/// The scanner on its flight.
#[derive(Clone, Debug)]
pub(super) struct AirborneScanner {
    seed: u64,
    world: World<Village>,
    attitude: Noise,
    /// Pulses sent so far.
    sent: i64,
    /// Height of the ground last met, metres: where to look for it next.
    ground: f64,
    hits: Vec<Hit>,
    echoes: Vec<Echo>,
}

impl AirborneScanner {
    /// A flight over the landscape of a seed.
    pub(super) fn new(seed: u64) -> Self {
        let (world, attitude) = (World::new(Village::new(seed)), Noise::new(hash(seed, 4, -1)));
        Self { seed, world, attitude, sent: 0, ground: 250.0, hits: Vec::new(), echoes: Vec::new() }
    }

    /// Metres flown.
    pub(super) fn travelled(&self) -> f64 {
        seconds(self.sent) * SPEED
    }

    /// Sends one pulse and appends its returns.
    pub(super) fn fire(&mut self, returns: &mut impl Extend<ScenePoint>) {
        let pulse = self.sent;
        self.sent += 1;
        let mut random = Random::at(self.seed, pulse, 2);
        let (ray, moment) = self.aim(pulse, &mut random);
        self.world.advance(ray.origin[0]);
        let village = *self.world.layout();
        let guess = (ray.origin[2] - self.ground) / -ray.direction[2];
        let Some(distance) = meet(|x, y| village.ground(x, y), &ray, guess, 1000.0) else { return };
        let [x, y, z] = ray.at(distance);
        self.ground = z;
        self.hits.clear();
        self.world.cast(&ray, distance, &mut random, &mut self.hits);
        for hit in &self.hits {
            if let Some(placed) = self.world.part(hit) {
                self.echoes.push(Echo::of_part(placed, hit, &ray));
            }
        }
        let kind = village.surface(x, y);
        // Meadows are rougher than roads, and brighter at this wavelength.
        let (roughness, reflectance) = if kind == Kind::Road { (0.0, 0.15) } else { (0.025, 0.4) };
        self.echoes.push(Echo::of_ground(distance + roughness * random.gaussian(), reflectance, kind));
        self.disturb(distance, &mut random);
        RECEIVER.record(&ray, moment, &mut self.echoes, &mut random, returns);
    }

    /// Now and then a bird flies through the beam, or an echo comes late and seems to lie below the ground.
    fn disturb(&mut self, ground: f64, random: &mut Random) {
        let luck = random.unit();
        if luck < BIRDS {
            let above = random.between(25.0, 120.0);
            self.echoes.push(Echo::of_noise(ground - above, 0.5, class::HIGH_NOISE));
        } else if luck < BIRDS + MULTIPATH {
            self.echoes.clear();
            self.echoes.push(Echo::of_noise(ground + random.between(2.0, 14.0), 1.0, class::LOW_NOISE));
        }
    }

    /// The ray of a pulse.
    fn aim(&self, pulse: i64, random: &mut Random) -> (Ray, Moment) {
        let time = seconds(pulse);
        let (sweep, share) = sweep_at(pulse);
        let is_leftward = (sweep / 2.0).floor() * 2.0 >= sweep; // every other
        let from_middle = (2.0 * share - 1.0) * if is_leftward { 1.0 } else { -1.0 };
        // The mirror slows down before it turns.
        let mirror = from_middle * (1.3 - 0.3 * from_middle * from_middle);
        let roll = 0.008 * self.attitude.along(time / 1.7);
        let pitch = 0.006 * self.attitude.along(1e4 + time / 2.3);
        let across = HALF_SCAN * mirror + roll + POINTING_NOISE * random.gaussian();
        let ahead = LOOK_AHEAD + pitch + POINTING_NOISE * random.gaussian();
        let drift = 1.5 * self.attitude.along(2e4 + time / 5.0);
        let lift = 1.0 * self.attitude.along(3e4 + time / 4.0);
        let ray = Ray {
            origin: [SPEED * time, drift, ALTITUDE + lift],
            direction: unit([ahead, across, -1.0]),
            aperture: 0.01,
            spread: 3e-4,
        };
        let moment = Moment {
            gps_time: FIRST_GPS_TIME + time,
            scan_direction: is_leftward,
            edge_of_flight_line: sweep_at(pulse + 1).0 > sweep,
        };
        (ray, moment)
    }
}

/// When a pulse is sent, seconds after the first; pulses are numbered far below 2⁵³.
fn seconds(pulse: i64) -> f64 {
    pulse as f64 / PULSES
}

/// Number of the sweep that a pulse belongs to, and how much of it has passed.
fn sweep_at(pulse: i64) -> (f64, f64) {
    let sweeps = seconds(pulse) * SWEEPS;
    (sweeps.floor(), sweeps - sweeps.floor())
}
