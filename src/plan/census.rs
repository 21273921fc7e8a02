//! Counts the points of a cloud in narrow slabs along x and along y, in one pass and in bounded memory.
//!
//! Slabs are as narrow as the segmentor allows. Where there turn out to be too many, they are made twice as wide.
//! Slabs are anchored at absolute zero, so two neighbors make one of twice the width, and the counts stay exact.

use rustc_hash::FxHashMap;

use crate::error::Result;
use crate::lattice::{Lattice, whole_steps};
use crate::span::{Chunk, Direction, SlabIndex};

/// More slabs than this are made wider. So many take a megabyte or two, here and later in the run.
const MOST_SLABS: usize = 1 << 14;

/// The narrowest slabs where the segmentor asks for none: 2⁻²⁰, so that they become wider until they are as few as that.
const NARROWEST: f64 = 1.0 / 1_048_576.0;

/// Where rounding may put a point into the next slab, slabs have to be a little wider than the reach.
const ROUNDING: f64 = 2e-6;

/// How many points of a cloud lie where along x and along y.
#[derive(Debug, Clone)]
pub struct Census {
    counts: [Counts; 2],
    points: u64,
}

impl Census {
    /// Of nothing yet. Slabs are at least as wide as `reach`, in units of the coordinates; 0 or ∞ if nothing is known of it.
    pub fn new(reach: f64, lattice: &Lattice) -> Self {
        Self {
            counts: [Direction::X, Direction::Y].map(|direction| Counts::new(reach, direction, *lattice)),
            points: 0,
        }
    }

    /// Counts the points of a chunk.
    ///
    /// # Errors
    /// If a valid point cannot be put into a slab.
    pub fn add(&mut self, chunk: &Chunk) -> Result<()> {
        self.points += chunk.points.len() as u64;
        self.counts.iter_mut().try_for_each(|counts| counts.add(&chunk.points))
    }

    /// How many points there are.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// The counts along x, then those along y.
    pub fn counts(&self) -> &[Counts; 2] {
        &self.counts
    }
}

/// How many points lie in each slab along a direction.
#[derive(Debug, Clone)]
pub struct Counts {
    direction: Direction,
    lattice: Lattice,
    width: f64,
    slab_of: SlabIndex,
    of_slab: FxHashMap<i64, u64>,
    /// The slab of the last point: a point with no valid position counts there, as it is put there.
    at: i64,
}

impl Counts {
    fn new(reach: f64, direction: Direction, lattice: Lattice) -> Self {
        let width = if reach > 0.0 && reach.is_finite() { narrowest(reach, direction, &lattice) } else { NARROWEST };
        let slab_of = SlabIndex::new(width, direction, &lattice);
        Self { direction, lattice, width, slab_of, of_slab: FxHashMap::default(), at: 0 }
    }

    fn add(&mut self, points: &[[f64; 3]]) -> Result<()> {
        for point in points {
            self.at = loop {
                match self.slab_of.of(point) {
                    Ok(slab) => break slab.unwrap_or(self.at),
                    Err(error) if !(self.width * 2.0).is_finite() => return Err(error),
                    Err(_) => self.widen(),
                }
            };
            *self.of_slab.entry(self.at).or_default() += 1;
            while self.of_slab.len() > MOST_SLABS {
                self.widen();
            }
        }
        Ok(())
    }

    fn widen(&mut self) {
        self.width *= 2.0;
        self.slab_of = SlabIndex::new(self.width, self.direction, &self.lattice);
        for (slab, points) in std::mem::take(&mut self.of_slab) {
            *self.of_slab.entry(slab.div_euclid(2)).or_default() += points;
        }
        self.at = self.at.div_euclid(2);
    }

    /// Along which the slabs follow each other.
    pub fn direction(&self) -> Direction {
        self.direction
    }

    /// The width of a slab, in units of the coordinates.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// The slabs with points in order, and how many points each has.
    pub fn slabs(&self) -> Vec<(i64, u64)> {
        let mut slabs: Vec<(i64, u64)> = self.of_slab.iter().map(|(&slab, &points)| (slab, points)).collect();
        slabs.sort_unstable();
        slabs
    }
}

/// The narrowest slabs of which two neighbors hold every pair of points within `reach`.
fn narrowest(reach: f64, direction: Direction, lattice: &Lattice) -> f64 {
    let step = lattice.scale()[usize::from(direction == Direction::Y)];
    let steps = whole_steps(reach, step).unwrap_or((reach / step).ceil());
    let width = steps * step;
    if lattice.is_whole() && SlabIndex::new(width, direction, lattice).is_exact() {
        width
    } else {
        reach * (1.0 + ROUNDING)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn census(reach: f64, lattice: &Lattice, points: &[[f64; 3]]) -> Census {
        let mut census = Census::new(reach, lattice);
        for points in points.chunks(7) {
            census.add(&Chunk { points: points.to_vec(), attributes: vec![] }).unwrap();
        }
        census
    }

    proptest! {
        #[test]
        fn counts_are_those_of_the_slabs_that_the_run_will_have(
            points in prop::collection::vec([-9_000i32..9_000, -50i32..50], 1..300),
            far in prop::option::of(Just(1e17)),
            reach in prop_oneof![Just(0.0), Just(f64::INFINITY), 0.001f64..3.0],
        ) {
            let lattice = Lattice::new([0.01, 0.002, 1.0], [500_000.0, -0.5, 0.0]).unwrap();
            let mut points: Vec<[f64; 3]> = points.iter().map(|&[x, y]| [f64::from(x), f64::from(y), 0.0]).collect();
            points.extend(far.map(|far| [far, 0.0, 0.0]));
            let census = census(reach, &lattice, &points);
            prop_assert_eq!(census.points(), points.len() as u64);
            for counts in census.counts() {
                let slab_of = SlabIndex::new(counts.width(), counts.direction(), &lattice);
                let mut expected: BTreeMap<i64, u64> = BTreeMap::new();
                for point in &points {
                    *expected.entry(slab_of.of(point).unwrap().unwrap()).or_default() += 1;
                }
                prop_assert_eq!(counts.slabs(), expected.into_iter().collect::<Vec<_>>());
                prop_assert!(!reach.is_finite() || counts.width() >= reach * (1.0 - 1e-9));
            }
        }
    }

    #[test]
    fn too_many_slabs_are_made_wider_and_invalid_points_stay_with_those_before_them() {
        let mut points: Vec<[f64; 3]> = (0..50_000).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        points.push([7.0, f64::NAN, 0.0]);
        let census = census(1.0, &Lattice::new([1.0; 3], [0.0; 3]).unwrap(), &points);
        let [along_x, along_y] = census.counts();
        let slabs = along_x.slabs();
        assert_eq!((along_x.width(), slabs.len(), slabs[0], slabs[12_499]), (4.0, 12_500, (0, 4), (12_499, 5)));
        assert_eq!(along_y.slabs(), [(0, 50_001)]);
    }

    #[test]
    fn slabs_are_as_narrow_as_the_reach_where_that_is_exact() {
        let lattice = Lattice::new([0.01; 3], [0.0; 3]).unwrap();
        assert_eq!(narrowest(0.05, Direction::X, &lattice), 0.05);
        assert_eq!(narrowest(0.051, Direction::X, &lattice), 0.06);
        assert!(narrowest(0.05, Direction::X, &Lattice::REAL) > 0.05);
    }
}
