//! A mobile scanner: a profiler on a van spins the beam through a full circle, a helix of profiles along the street.
//!
//! Driving 8 m/s with 80 turns a second of 800 pulses each: profiles 0.1 m apart, points 5 cm apart on the near facades.
//! The plane of the circle is turned from across the street by 37° and leans back by 16°, so that walls across the street,
//! poles and jambs are seen; what stands in front hides what is behind.

use super::classification as class;
use super::geometry::{Ray, Vector, add, dot, scale, subtract, unit};
use super::pulse::{Echo, Moment, Receiver};
use super::random::{Random, hash};
use super::road::Street;
use super::shape::{Hit, Kind};
use super::terrain::Noise;
use super::world::World;
use super::{FIRST_GPS_TIME, ScenePoint};

/// Metres per second.
const SPEED: f64 = 8.0;
/// Turns of the mirror per second.
const TURNS: f64 = 80.0;
/// Pulses per turn.
const PULSES_PER_TURN: u16 = 800;
/// Height of the scanner above the road, metres.
const MAST: f64 = 2.4;
/// Where the van drives, metres to the left of the middle of the street.
const LANE: f64 = -1.6;
/// Farthest and nearest range, metres.
const REACH: f64 = 80.0;
const BLIND: f64 = 1.0;
/// Standard deviation of the pointing, radians: 2 mm at 10 m.
const POINTING_NOISE: f64 = 2e-4;
/// Probability that a pulse meets dust or drizzle, and that it seems to come from below a wet road.
const DUST: f64 = 3e-5;
const MULTIPATH: f64 = 3e-5;
/// Probability that a window pane mirrors a pulse away.
const MIRRORED: f64 = 0.6;

const RECEIVER: Receiver = Receiver { range_noise: 0.004, resolution: 0.3, threshold: 0.004, most_returns: 3 };

/// The scanner on its drive.
#[derive(Clone, Debug)]
pub(super) struct StreetScanner {
    seed: u64,
    world: World<Street>,
    attitude: Noise,
    circle: Vec<[f64; 2]>,
    /// Pulses sent so far.
    sent: i64,
    hits: Vec<Hit>,
    echoes: Vec<Echo>,
}

impl StreetScanner {
    /// A drive along the street of a seed.
    pub(super) fn new(seed: u64) -> Self {
        Self {
            seed,
            world: World::new(Street::new(seed)),
            attitude: Noise::new(hash(seed, 8, -1)),
            circle: unit_circle(PULSES_PER_TURN),
            sent: 0,
            hits: Vec::new(),
            echoes: Vec::new(),
        }
    }

    /// Metres driven.
    pub(super) fn travelled(&self) -> f64 {
        seconds(self.sent) * SPEED
    }

    /// Sends one pulse and appends its returns, if any: many pulses go to the sky.
    pub(super) fn fire(&mut self, returns: &mut impl Extend<ScenePoint>) {
        let pulse = self.sent;
        self.sent += 1;
        let mut random = Random::at(self.seed, pulse, 2);
        let (ray, moment) = self.aim(pulse, &mut random);
        self.world.advance(ray.origin[0]);
        let street = *self.world.layout();
        let ground = street.strike(&ray, MAST / ray.direction[2].abs().max(0.05), REACH);
        let end = ground.map_or(REACH, |(distance, _)| distance);
        self.hits.clear();
        self.world.cast(&ray, end, &mut random, &mut self.hits);
        for hit in &self.hits {
            if let Some(placed) = self.world.part(hit) {
                let mut echo = Echo::of_part(placed, hit, &ray);
                if hit.brightness < 1.0 && random.chance(MIRRORED) {
                    echo.reflectance = 0.0;
                }
                self.echoes.push(echo);
            }
        }
        if let Some((distance, kind)) = ground {
            let slant = 0.2 + 0.8 * ray.direction[2].abs();
            let reflectance = slant * if kind == Kind::Road { 0.2 } else { 0.35 };
            self.echoes.push(Echo::of_ground(distance, reflectance, kind));
        }
        self.disturb(end, &mut random);
        self.echoes.retain(|echo| echo.distance > BLIND);
        RECEIVER.record(&ray, moment, &mut self.echoes, &mut random, returns);
    }

    /// Now and then dust near the scanner returns part of a pulse, or a detour over a wet road makes it seem too long.
    fn disturb(&mut self, end: f64, random: &mut Random) {
        let luck = random.unit();
        if luck < DUST {
            self.echoes.push(Echo::of_noise(random.between(1.5, 6.0), 0.4, class::HIGH_NOISE));
        } else if luck < DUST + MULTIPATH && end < REACH / 2.0 {
            self.echoes.clear();
            self.echoes.push(Echo::of_noise(end + random.between(0.5, 5.0), 1.0, class::LOW_NOISE));
        }
    }

    /// The ray of a pulse; a turn starts and ends looking down.
    fn aim(&self, pulse: i64, random: &mut Random) -> (Ray, Moment) {
        let time = seconds(pulse);
        let number = usize::try_from(pulse.rem_euclid(i64::from(PULSES_PER_TURN))).unwrap_or_default();
        let [cosine, sine] = self.circle[number];
        let sway = 0.03 * self.attitude.along(time / 3.1);
        let mut van = self.world.layout().beside(SPEED * time, LANE + sway);
        van.origin[2] += MAST + 0.01 * self.attitude.along(1e4 + time / 0.8);
        let nod = 0.004 * self.attitude.along(2e4 + time / 0.9);
        // In the plane of the circle: one direction up, leaning back, and one to the left and backwards, both unit.
        let up = unit([-0.28 + nod, 0.0, 0.96]);
        let level: Vector = [-0.6, 0.8, 0.0];
        let left = unit(subtract(level, scale(up, dot(level, up))));
        let [along, across, rise] = add(scale(up, -cosine), scale(left, -sine));
        let [east, north] = van.forward;
        let mut jitter = || POINTING_NOISE * random.gaussian();
        let turned =
            [along * east - across * north + jitter(), along * north + across * east + jitter(), rise + jitter()];
        let ray = Ray { origin: van.origin, direction: unit(turned), aperture: 0.002, spread: 1.5e-4 };
        let moment = Moment {
            gps_time: FIRST_GPS_TIME + time,
            scan_direction: true,
            edge_of_flight_line: number + 1 == usize::from(PULSES_PER_TURN),
        };
        (ray, moment)
    }
}

/// When a pulse is sent, seconds after the first; pulses are numbered far below 2⁵³.
fn seconds(pulse: i64) -> f64 {
    pulse as f64 / (TURNS * f64::from(PULSES_PER_TURN))
}

/// Cosine and sine of the angles that divide the circle in `count`.
///
/// By repeated turning, from a series for the first angle: the sine of the platform need not be the same everywhere.
fn unit_circle(count: u16) -> Vec<[f64; 2]> {
    let angle = std::f64::consts::TAU / f64::from(count);
    let square = angle * angle;
    let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0));
    let sine = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)));
    let turn = |[x, y]: &[f64; 2]| Some([x * cosine - y * sine, x * sine + y * cosine]);
    std::iter::successors(Some([1.0, 0.0]), turn).take(usize::from(count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_circle_closes() {
        for (number, [cosine, sine]) in (0..800_u16).zip(unit_circle(800)) {
            let angle = f64::from(number) * std::f64::consts::TAU / 800.0;
            assert!((cosine - angle.cos()).abs() < 1e-11 && (sine - angle.sin()).abs() < 1e-11);
        }
    }
}
