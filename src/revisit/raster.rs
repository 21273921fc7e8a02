//! Cells of the map, about as wide as relations reach: two points that may be related lie in cells side by side.

use rustc_hash::FxHashSet;

use crate::lattice::{Lattice, is_valid};

/// Cells are wider than the reach by this much, so that rounding takes no pair two cells apart.
const SLACK: f64 = 1e-6;

/// Whatever lies farther out falls into the outermost cells: beyond, coordinates are too coarse to tell cells apart.
const OUTERMOST: f64 = (1u64 << 50) as f64;

/// What rounding may do to the position of a point in cells, relative to it.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A cell, or a block of cells, of the map; row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Cell {
    pub row: i64,
    pub column: i64,
}

/// Says which cell a point is in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Raster {
    lattice: Lattice,
    side: f64,
}

impl Raster {
    /// Cells as wide as `reach`, in units of the coordinates.
    pub fn new(reach: f64, lattice: Lattice) -> Self {
        Self { lattice, side: reach * (1.0 + 2.0 * SLACK) / lattice.horizontal_unit() }
    }

    /// The cell of a point; none if the point is not valid.
    #[inline]
    pub fn cell_of(&self, point: &[f64; 3]) -> Option<Cell> {
        let [x, y] = self.lattice.horizontal(point);
        let index = |along: f64| (along / self.side).floor().clamp(-OUTERMOST, OUTERMOST) as i64;
        is_valid(point).then(|| Cell { row: index(y), column: index(x) })
    }

    /// The cells that hold any of the points.
    pub fn occupied<'a>(&self, points: impl Iterator<Item = &'a [f64; 3]>) -> FxHashSet<Cell> {
        let (mut occupied, mut last) = (FxHashSet::default(), None);
        for cell in points.filter_map(|point| self.cell_of(point)) {
            // Points that follow each other are mostly near each other.
            if last != Some(cell) {
                occupied.insert(cell);
                last = Some(cell);
            }
        }
        occupied
    }
}

/// All cells that may hold a point within reach of one in the cells `occupied`.
pub(super) fn surroundings(occupied: &FxHashSet<Cell>) -> FxHashSet<Cell> {
    let mut around = FxHashSet::default();
    for cell in occupied {
        let farthest = cell.row.unsigned_abs().max(cell.column.unsigned_abs()) as f64;
        let steps = (1.0 - SLACK + ROUNDING * farthest).ceil() as i64;
        for row in cell.row - steps..=cell.row + steps {
            around.extend((cell.column - steps..=cell.column + steps).map(|column| Cell { row, column }));
        }
    }
    around
}

/// Square blocks of cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blocks {
    /// How many cells a block is wide.
    pub cells: i64,
}

impl Blocks {
    /// Blocks that hold some `points` points of one span each, going by a span of `count` points in `occupied` cells.
    pub fn of_about(points: usize, count: usize, occupied: usize) -> Self {
        let per_cell = count.max(1) as f64 / occupied.max(1) as f64;
        Self { cells: ((points as f64 / per_cell).sqrt().ceil() as i64).clamp(1, 64) }
    }

    /// The block of a cell.
    #[inline]
    pub fn of(self, cell: Cell) -> Cell {
        Cell { row: cell.row.div_euclid(self.cells), column: cell.column.div_euclid(self.cells) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::{Metric, Within};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn whoever_is_in_reach_is_in_the_surroundings(
            at in prop_oneof![Just(0.0), Just(-3.0), Just(5e6), Just(1e9), Just(1e14), Just(1e17)],
            step in prop_oneof![Just([0i32; 2]), [-9i32..9, -9i32..9].prop_map(|step| step)],
            reach in prop_oneof![Just(0.3), Just(1.0), Just(7.0)],
            whole: bool,
        ) {
            let lattice = if whole { Lattice::new([0.1, 0.2, 0.1], [0.0; 3]).unwrap() } else { Lattice::REAL };
            let a = [at, at, 0.0];
            let by = |axis: usize| f64::from(step[axis]) * if whole { 1.0 } else { 0.1 };
            let b = [at + by(0), at + by(1), 0.0];
            let raster = Raster::new(reach, lattice);
            let around = surroundings(&raster.occupied([a].iter()));
            if Within::new(reach, Metric::Xy, &lattice).pair(&a, &b) {
                prop_assert!(around.contains(&raster.cell_of(&b).unwrap()));
            }
            let far = raster.cell_of(&[a[0] + 1e6, a[1], 0.0]).unwrap();
            prop_assert!(at > 1e12 || !around.contains(&far));
        }
    }

    #[test]
    fn an_invalid_point_is_nowhere_and_a_stray_one_costs_no_more_than_others() {
        let raster = Raster::new(1.0, Lattice::REAL);
        assert_eq!(raster.cell_of(&[f64::NAN, 0.0, 0.0]), None);
        assert!(surroundings(&raster.occupied([[1e59, -1e59, 0.0]].iter())).len() < 100);
        assert_eq!(surroundings(&raster.occupied([[0.5, 0.5, 0.0]].iter())).len(), 9);
    }

    #[test]
    fn blocks_hold_about_as_many_points_as_asked_for() {
        assert_eq!(Blocks::of_about(64, 1000, 1000).cells, 8);
        assert_eq!(Blocks::of_about(64, 100_000, 1000).cells, 1);
        assert_eq!(Blocks::of_about(64, 0, 0).cells, 8);
        assert_eq!(Blocks { cells: 8 }.of(Cell { row: -1, column: 8 }), Cell { row: -1, column: 1 });
    }
}
