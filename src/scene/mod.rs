//! Made-up lidar surveys of any length, with the truth: which object each point is on.
//!
//! Two sensors are simulated pulse by pulse, as rays cast against analytic geometry: an airborne scanner over a village and
//! a mobile scanner in a street. The order of things: `random` and `terrain` give every place its own numbers; `shape`
//! (`panel`, `rod`, `crown`) knows where a pulse meets a surface; `house`, `tree`, `car` and `mast` build objects of
//! shapes; `village` and `road` say what stands where; `world` keeps the blocks near the scanner and `walk` leads a pulse
//! through them; `airborne` and `street` aim; `pulse` turns what was met into returns.
//!
//! The same seed gives the same points on every machine that computes doubles as IEEE 754 has it (the x87 does not): only
//! basic operations, square roots and rounding are used, no function whose last bit is left to the platform. Memory does
//! not grow with the number of points.
//!
//! ```
//! use streamseg::scene::{GROUND_OBJECT, Scene, ScenePoint};
//!
//! let strip: Vec<ScenePoint> = Scene::airborne_strip(7).take(100_000).collect();
//! let on_objects = strip.iter().filter(|point| point.object_id > GROUND_OBJECT).count();
//! assert!((10_000..50_000).contains(&on_objects));
//! ```

mod airborne;
mod car;
mod crown;
mod geometry;
mod house;
mod mast;
mod panel;
mod pulse;
mod random;
mod road;
mod rod;
mod shape;
mod street;
mod terrain;
mod tree;
mod village;
mod walk;
mod world;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use airborne::AirborneScanner;
use street::StreetScanner;

/// Metres per lattice step.
pub const SCALE: f64 = 0.001;

/// Coordinates of the lattice point `[0, 0, 0]`, metres: easting, northing, height, as of a UTM zone.
pub const OFFSET: [f64; 3] = [500_000.0, 5_400_000.0, 0.0];

/// `object_id` of ground, roads and kerbs: one object.
pub const GROUND_OBJECT: i64 = 1;

/// `object_id` of points that are on no object: noise.
pub const NO_OBJECT: i64 = -1;

/// `gps_time` of the first pulse: adjusted standard GPS seconds.
const FIRST_GPS_TIME: f64 = 400_000_000.0;

/// A scene ends after so many metres, where its lattice does.
const LENGTH: f64 = 2_140_000.0;

/// The values of [`ScenePoint::classification`]: ASPRS classes of LAS 1.4, and two of the user-definable ones.
pub mod classification {
    /// Bare ground, pavements, kerbs, yards.
    pub const GROUND: u8 = 2;
    /// Plants below 0.5 m.
    pub const LOW_VEGETATION: u8 = 3;
    /// Plants from 0.5 m to 2 m.
    pub const MEDIUM_VEGETATION: u8 = 4;
    /// Plants from 2 m up.
    pub const HIGH_VEGETATION: u8 = 5;
    /// Houses with all that belongs to them.
    pub const BUILDING: u8 = 6;
    /// Points below the ground that are not there.
    pub const LOW_NOISE: u8 = 7;
    /// Carriageways.
    pub const ROAD_SURFACE: u8 = 11;
    /// Wires, of power lines and to houses.
    pub const WIRE_CONDUCTOR: u8 = 14;
    /// Pylons and poles that carry wires.
    pub const TRANSMISSION_TOWER: u8 = 15;
    /// Birds and dust.
    pub const HIGH_NOISE: u8 = 18;
    /// User-definable: cars.
    pub const CAR: u8 = 64;
    /// User-definable: lamp posts and signs.
    pub const POLE: u8 = 65;
}

/// One return of one pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScenePoint {
    /// On the lattice: `OFFSET + SCALE * position` is easting, northing and height in metres.
    pub position: [i32; 3],
    /// When the pulse was sent, adjusted standard GPS seconds. Never decreases along a scene.
    pub gps_time: f64,
    /// Strength of the echo, 65535 for all of a pulse.
    pub intensity: u16,
    /// Which return of its pulse this is, from 1, nearest first.
    pub return_number: u8,
    /// How many returns the pulse has.
    pub number_of_returns: u8,
    /// What the point is on, one of the constants in [`classification`].
    pub classification: u8,
    /// The mirror was moving to the left of the track.
    pub scan_direction: bool,
    /// The pulse was the last of its scan line.
    pub edge_of_flight_line: bool,
    /// The object that the point is on: [`NO_OBJECT`], [`GROUND_OBJECT`] or, from 2 up, one house with its roof and
    /// garage, one tree, one span of wire between two supports, one pylon, one car, one pole.
    pub object_id: i64,
}

impl ScenePoint {
    /// Easting, northing and height, metres.
    #[must_use]
    pub fn xyz(&self) -> [f64; 3] {
        let along = |axis: usize| OFFSET[axis] + SCALE * f64::from(self.position[axis]);
        [along(0), along(1), along(2)]
    }
}

/// A survey as an iterator of points in the order in which they were measured.
///
/// The track runs along +x from x = 0 and goes on for 2 140 km, the end of the lattice; take as many points as you need.
#[derive(Clone, Debug)]
pub struct Scene {
    scanner: Scanner,
    /// Returns of the last pulse that are not handed out yet.
    returns: VecDeque<ScenePoint>,
}

#[derive(Clone, Debug)]
enum Scanner {
    Airborne(AirborneScanner),
    Street(StreetScanner),
}

impl Scene {
    /// A flight strip over rolling country: villages, groves, a power line. 200 m wide, about nine points per square metre.
    #[must_use]
    pub fn airborne_strip(seed: u64) -> Self {
        Self { scanner: Scanner::Airborne(AirborneScanner::new(seed)), returns: VecDeque::new() }
    }

    /// A drive along a street between two rows of houses: about five thousand points per metre.
    #[must_use]
    pub fn street(seed: u64) -> Self {
        Self { scanner: Scanner::Street(StreetScanner::new(seed)), returns: VecDeque::new() }
    }
}

impl Iterator for Scene {
    type Item = ScenePoint;

    fn next(&mut self) -> Option<ScenePoint> {
        while self.returns.is_empty() {
            match &mut self.scanner {
                Scanner::Airborne(scanner) if scanner.travelled() < LENGTH => scanner.fire(&mut self.returns),
                Scanner::Street(scanner) if scanner.travelled() < LENGTH => scanner.fire(&mut self.returns),
                _ => return None,
            }
        }
        self.returns.pop_front()
    }
}

impl std::iter::FusedIterator for Scene {}
