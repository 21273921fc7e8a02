//! Random clouds on a small lattice, full of what trips triangulators and distance tests: points that coincide, lie on
//! one line, on one circle, on top of each other, or at exactly the distance from each other.
// Each test binary uses what it needs of it.
#![allow(dead_code)]

use proptest::prelude::*;
use streamseg::lattice::Lattice;

/// Lattice coordinates.
pub type Place = [i64; 3];

/// As many cases as given, scaled by the environment's `PROPTEST_CASES` (256 means once).
pub fn cases(count: u32) -> ProptestConfig {
    let scaled = u64::from(count) * u64::from(ProptestConfig::default().cases) / 256;
    let cases = u32::try_from(scaled.max(1)).unwrap_or(u32::MAX);
    // The smallest failing input is printed in full; there is no need to keep seeds.
    ProptestConfig { cases, failure_persistence: None, max_shrink_iters: 20_000, ..ProptestConfig::default() }
}

/// Clouds of up to some hundred points in any order, the empty cloud and single points among them.
pub fn cloud() -> impl Strategy<Value = Vec<Place>> {
    let part = prop_oneof![quantised(), line(), circle(), stack(), sparse(), pairs()];
    let parts = prop::collection::vec(part, 0..4).prop_map(|parts| parts.concat()).prop_shuffle();
    prop_oneof![1 => Just(vec![]), 1 => sparse().prop_map(|p| p.into_iter().take(1).collect()), 18 => parts]
}

/// Points on so coarse a grid that many coincide or share circles.
fn quantised() -> impl Strategy<Value = Vec<Place>> {
    prop::collection::vec((-8i64..8, -8i64..8, -2i64..3).prop_map(Place::from), 0..50)
}

/// Points at even steps along a line of any direction.
fn line() -> impl Strategy<Value = Vec<Place>> {
    ((-20i64..20, -20i64..20, -5i64..5), (-4i64..5, -4i64..5, -1i64..2), 0i64..25)
        .prop_map(|((x, y, z), (dx, dy, dz), count)| (0..count).map(|k| [x + k * dx, y + k * dy, z + k * dz]).collect())
}

/// Some of the twelve lattice points of a circle of radius 5, or of one five times as large.
fn circle() -> impl Strategy<Value = Vec<Place>> {
    const RIM: [[i64; 2]; 12] =
        [[5, 0], [4, 3], [3, 4], [0, 5], [-3, 4], [-4, 3], [-5, 0], [-4, -3], [-3, -4], [0, -5], [3, -4], [4, -3]];
    let on_rim = prop::collection::vec((prop::sample::select(&RIM[..]), -2i64..3), 0..16);
    (-15i64..15, -15i64..15, prop::sample::select(vec![1i64, 5]), on_rim).prop_map(|(x, y, size, on_rim)| {
        on_rim.into_iter().map(|([dx, dy], z)| [x + size * dx, y + size * dy, z]).collect()
    })
}

/// A few places with points at many heights each.
fn stack() -> impl Strategy<Value = Vec<Place>> {
    prop::collection::vec(((-3i64..3, -3i64..3), prop::collection::vec(-9i64..9, 1..6)), 0..6).prop_map(|stacks| {
        stacks.into_iter().flat_map(|((x, y), heights)| heights.into_iter().map(move |z| [2 * x, 2 * y, z])).collect()
    })
}

/// Points in general position, mostly.
fn sparse() -> impl Strategy<Value = Vec<Place>> {
    prop::collection::vec((-60i64..60, -60i64..60, -10i64..10).prop_map(Place::from), 0..40)
}

/// Points with a second one five or thirteen steps away.
fn pairs() -> impl Strategy<Value = Vec<Place>> {
    let step = prop::sample::select(vec![[3i64, 4], [4, -3], [5, 0], [0, 5], [5, 12], [12, -5]]);
    prop::collection::vec(((-30i64..30, -30i64..30, -2i64..2), step), 0..15).prop_map(|pairs| {
        pairs.into_iter().flat_map(|((x, y, z), [dx, dy])| [[x, y, z], [x + dx, y + dy, z]]).collect()
    })
}

/// Squared distances, in lattice steps, that integer pairs often have exactly.
pub fn squared_distance() -> impl Strategy<Value = i64> {
    prop::sample::select(vec![1i64, 2, 4, 5, 8, 9, 10, 16, 25, 50, 100, 169])
}

/// How a cloud's places are told to the library.
#[derive(Debug, Clone, Copy)]
pub struct Survey {
    /// The lattice told.
    pub lattice: Lattice,
    /// Length of one unit in real units.
    pub unit: f64,
    /// Units per lattice step, by axis.
    pub stretch: [i64; 3],
    offset: [f64; 3],
}

impl Survey {
    pub fn whole(unit: f64, stretch: [i64; 3], offset: [f64; 3]) -> Self {
        let scale = stretch.map(|s| s as f64 * unit);
        Self { lattice: Lattice::new(scale, offset).unwrap(), unit, stretch, offset }
    }

    fn real(unit: f64, offset: [f64; 3]) -> Self {
        Self { lattice: Lattice::REAL, unit, stretch: [1; 3], offset }
    }

    /// Whether the positions on the map that the library computes with are the oracle's, but for a common factor. If not,
    /// what lies exactly between two places for the oracle may lie just beside the line for the library.
    pub fn is_exact_on_the_map(&self) -> bool {
        self.stretch[0] == self.stretch[1] && (self.lattice.is_whole() || self.unit == 1.0)
    }

    /// The coordinates that the library gets.
    pub fn told(&self, cloud: &[Place]) -> Vec<[f64; 3]> {
        let tell = |place: &Place| {
            std::array::from_fn(|k| {
                let coordinate = place[k] as f64;
                if self.lattice.is_whole() { coordinate } else { coordinate * self.unit + self.offset[k] }
            })
        };
        cloud.iter().map(tell).collect()
    }

    /// The coordinates that an oracle computes with, whole numbers of units.
    pub fn in_units(&self, cloud: &[Place]) -> Vec<Place> {
        cloud.iter().map(|place| std::array::from_fn(|k| place[k] * self.stretch[k])).collect()
    }
}

/// Whole lattices, plain or as in a survey far from the origin, and the same as real numbers.
pub fn survey() -> impl Strategy<Value = Survey> {
    const UTM: [f64; 3] = [500_000.0, 5_400_000.0, 0.0];
    prop::sample::select(vec![
        Survey::whole(1.0, [1; 3], [0.0; 3]),
        Survey::whole(0.01, [1; 3], UTM),
        Survey::whole(0.01, [1, 2, 1], UTM),
        Survey::real(1.0, [0.0; 3]),
        Survey::real(0.01, UTM),
    ])
}
