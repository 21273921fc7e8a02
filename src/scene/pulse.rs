//! From the surfaces that a pulse meets to the points that a scanner records of it.
//!
//! 1. Each surface takes its share of what is left of the pulse.
//! 2. Echoes too weak, or too close behind the last one, are not told apart from it and are lost.
//! 3. The others become the returns 1 to n of the pulse, with range noise, an intensity and a class.

use super::ScenePoint;
use super::classification as class;
use super::geometry::{Ray, Vector};
use super::random::Random;
use super::shape::{Hit, Kind};
use super::world::PlacedPart;
use super::{GROUND_OBJECT, NO_OBJECT, SCALE};

/// What a receiver can do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver {
    /// Standard deviation of ranges, metres.
    pub(super) range_noise: f64,
    /// Two echoes closer than this are one, metres.
    pub(super) resolution: f64,
    /// Weakest echo that is detected, as a share of the energy sent.
    pub(super) threshold: f64,
    /// Most returns of a pulse.
    pub(super) most_returns: usize,
}

/// A surface that a pulse may give a return of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Echo {
    /// From the scanner, metres.
    pub(super) distance: f64,
    /// Share of what is left of the pulse that the surface intercepts.
    pub(super) coverage: f64,
    /// Share of that which comes back.
    pub(super) reflectance: f64,
    /// ASPRS class.
    pub(super) classification: u8,
    /// Which object it is on.
    pub(super) object_id: i64,
}

/// When a pulse was sent, and where in its scan line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Seconds.
    pub(super) gps_time: f64,
    /// The mirror moves towards positive y.
    pub(super) scan_direction: bool,
    /// The last pulse of its scan line.
    pub(super) edge_of_flight_line: bool,
}

impl Echo {
    /// An echo of a part of an object.
    pub(super) fn of_part(placed: &PlacedPart, hit: &Hit, ray: &Ray) -> Self {
        let height = ray.at(hit.distance)[2] - placed.ground;
        Self {
            distance: hit.distance,
            coverage: hit.coverage,
            // Rough surfaces, seen at a slant, still return a quarter.
            reflectance: placed.part.reflectance * hit.brightness * (0.25 + 0.75 * hit.cosine),
            classification: classify(placed.part.kind, height),
            object_id: placed.object_id,
        }
    }

    /// An echo of the ground.
    pub(super) const fn of_ground(distance: f64, reflectance: f64, kind: Kind) -> Self {
        let classification = if matches!(kind, Kind::Road) { class::ROAD_SURFACE } else { class::GROUND };
        Self { distance, coverage: 1.0, reflectance, classification, object_id: GROUND_OBJECT }
    }

    /// An echo of nothing real: a bird, a reflection.
    pub(super) const fn of_noise(distance: f64, coverage: f64, classification: u8) -> Self {
        Self { distance, coverage, reflectance: 0.3, classification, object_id: NO_OBJECT }
    }
}

/// The class of a point on a part, given its height above the ground in metres.
fn classify(kind: Kind, height: f64) -> u8 {
    match kind {
        Kind::Ground => class::GROUND,
        Kind::Road => class::ROAD_SURFACE,
        Kind::Building => class::BUILDING,
        Kind::Vegetation if height < 0.5 => class::LOW_VEGETATION,
        Kind::Vegetation if height < 2.0 => class::MEDIUM_VEGETATION,
        Kind::Vegetation => class::HIGH_VEGETATION,
        Kind::Wire => class::WIRE_CONDUCTOR,
        Kind::Tower => class::TRANSMISSION_TOWER,
        Kind::Car => class::CAR,
        Kind::Pole => class::POLE,
    }
}

impl Receiver {
    /// Appends the returns of a pulse; `echoes`, which may come in any order, is emptied.
    pub(super) fn record(
        &self,
        ray: &Ray,
        moment: Moment,
        echoes: &mut Vec<Echo>,
        random: &mut Random,
        returns: &mut impl Extend<ScenePoint>,
    ) {
        echoes.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        let mut left = 1.0;
        let mut last = f64::NEG_INFINITY;
        echoes.retain_mut(|echo| {
            let taken = left * echo.coverage;
            left -= taken;
            // From here on `reflectance` is the strength of the echo.
            echo.reflectance *= taken;
            let is_recorded = echo.reflectance > self.threshold && echo.distance > last + self.resolution;
            if is_recorded {
                last = echo.distance;
            }
            is_recorded
        });
        echoes.truncate(self.most_returns);
        let number_of_returns = u8::try_from(echoes.len()).unwrap_or(u8::MAX);
        let points = echoes.drain(..).zip(1..).map(|(echo, return_number)| {
            let noise = (self.range_noise * random.gaussian()).max(-self.resolution / 2.0);
            ScenePoint {
                position: to_lattice(ray.at(echo.distance + noise)),
                gps_time: moment.gps_time,
                intensity: to_intensity(echo.reflectance * (1.0 + 0.06 * random.gaussian())),
                return_number,
                number_of_returns,
                classification: echo.classification,
                scan_direction: moment.scan_direction,
                edge_of_flight_line: moment.edge_of_flight_line,
                object_id: echo.object_id,
            }
        });
        returns.extend(points);
    }
}

/// Metres to the nearest lattice point; scenes end before the lattice does.
fn to_lattice(position: Vector) -> [i32; 3] {
    position.map(|coordinate| (coordinate / SCALE + 0.5).floor() as i32)
}

/// Share of the pulse to the full range of 16 bits.
fn to_intensity(strength: f64) -> u16 {
    (strength * 65_535.0).clamp(1.0, 65_535.0) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECEIVER: Receiver = Receiver { range_noise: 0.0, resolution: 1.0, threshold: 0.01, most_returns: 3 };

    fn returns(surfaces: &[(f64, f64)]) -> Vec<(i32, u8, u8)> {
        let ray = Ray { origin: [0.0; 3], direction: [1.0, 0.0, 0.0], aperture: 0.1, spread: 0.0 };
        let moment = Moment { gps_time: 0.0, scan_direction: true, edge_of_flight_line: false };
        let echo =
            |&(distance, coverage): &(f64, f64)| Echo { coverage, ..Echo::of_ground(distance, 0.5, Kind::Ground) };
        let mut points = Vec::new();
        let mut echoes = surfaces.iter().map(echo).collect();
        RECEIVER.record(&ray, moment, &mut echoes, &mut Random::at(0, 0, 0), &mut points);
        points.iter().map(|point| (point.position[0], point.return_number, point.number_of_returns)).collect()
    }

    #[test]
    fn nothing_returns_from_behind_an_opaque_surface() {
        assert_eq!(returns(&[(20.0, 1.0), (10.0, 1.0)]), [(10_000, 1, 1)]);
    }

    #[test]
    fn close_echoes_merge_and_weak_ones_are_lost() {
        assert_eq!(returns(&[(10.0, 0.5), (10.5, 0.5), (20.0, 0.01), (30.0, 1.0)]), [(10_000, 1, 2), (30_000, 2, 2)]);
    }

    #[test]
    fn there_are_no_more_returns_than_the_receiver_counts() {
        let many: Vec<_> = (1..9).map(|number| (f64::from(number) * 5.0, 0.3)).collect();
        assert_eq!(returns(&many).len(), 3);
    }
}
