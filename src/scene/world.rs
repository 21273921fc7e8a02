//! The part of an endless scene around the scanner, and which of its objects a pulse meets.
//!
//! The scene is cut across the track into *blocks*. What stands in a block is a function of its number (and the seed), so
//! blocks are made when the scanner comes near and dropped when it has passed. Each holds a grid of cells with the parts
//! that reach into them; a pulse walks from cell to cell until it is used up.

use std::collections::VecDeque;

use super::geometry::{Bounds, Ray};
use super::random::Random;
use super::shape::{Hit, Object, Part};
use super::walk::{CELL, Walk, cell_of};

/// Length of a block along the track, metres. No object may reach farther than this beyond its own block.
pub(super) const BLOCK: f64 = 128.0;
/// Blocks and objects are known this far before and behind the scanner, metres.
const SIGHT: f64 = 100.0;
/// Columns of cells in a block.
const COLUMNS: i64 = 32;
/// Rows of cells, half of them on either side of the track.
const ROWS: i64 = 64;
const _: () = assert!(COLUMNS as f64 * CELL == BLOCK, "blocks are cut between cells");
/// Objects per block that ids have room for.
const IDS_PER_BLOCK: i64 = 4096;
/// The widest footprint for which parts are found, metres.
const WIDEST_FOOTPRINT: f64 = 0.2;
/// A pulse with less than this share of its energy left is followed no further.
const SPENT: f64 = 0.02;

/// What stands where.
pub(super) trait Layout {
    /// The objects that stand in a block, always the same ones in the same order; none before block 0.
    fn objects(&self, block: i64) -> Vec<Object>;
}

/// The number of the block that a position along the track lies in.
pub(super) fn block_at(x: f64) -> i64 {
    (x / BLOCK).floor() as i64
}

/// Where a block starts along the track, metres.
pub(super) fn start_of(block: i64) -> f64 {
    block as f64 * BLOCK
}

/// The id of the object with an ordinal among those of a block; 1 is the ground.
pub(super) fn object_id(block: i64, ordinal: usize) -> i64 {
    2 + block * IDS_PER_BLOCK + i64::try_from(ordinal).unwrap_or(IDS_PER_BLOCK).min(IDS_PER_BLOCK - 1)
}

/// A part with what its points need to know.
#[derive(Clone, Debug)]
pub(super) struct PlacedPart {
    /// The part.
    pub(super) part: Part,
    /// The object that it belongs to.
    pub(super) object_id: i64,
    /// Height of the ground where that object stands, metres.
    pub(super) ground: f64,
}

/// One block and the parts that reach into it, by cell.
#[derive(Clone, Debug)]
struct Block {
    parts: Vec<PlacedPart>,
    /// Where the parts of each cell start in `in_cells`, and where those of the last end.
    starts: Vec<usize>,
    in_cells: Vec<InCell>,
    /// Height above which there is nothing, metres.
    top: f64,
}

/// What of a part is in a cell.
#[derive(Clone, Copy, Debug)]
struct InCell {
    part: usize,
    /// Lowest and highest z, metres: most pulses pass above or below, and need no closer look.
    low: f64,
    high: f64,
}

/// The blocks around the scanner.
#[derive(Clone, Debug)]
pub(super) struct World<L> {
    layout: L,
    blocks: VecDeque<Block>,
    /// Number of the first of `blocks`.
    first: i64,
    top: f64,
}

impl<L: Layout> World<L> {
    /// A world in which nothing is built yet.
    pub(super) const fn new(layout: L) -> Self {
        Self { layout, blocks: VecDeque::new(), first: 0, top: f64::NEG_INFINITY }
    }

    /// What stands where.
    pub(super) const fn layout(&self) -> &L {
        &self.layout
    }

    /// Builds the blocks in sight of a scanner at `x` and drops those behind. `x` never decreases.
    pub(super) fn advance(&mut self, x: f64) {
        let (from, to) = (block_at(x - SIGHT).max(0), block_at(x + SIGHT));
        while self.first < from && self.blocks.pop_front().is_some() {
            self.first += 1;
        }
        if self.blocks.is_empty() {
            self.first = from;
        }
        let mut next = self.first + count(self.blocks.len());
        while next <= to {
            self.blocks.push_back(Block::build(&self.layout, next));
            next += 1;
            self.top = self.blocks.iter().fold(f64::NEG_INFINITY, |top, block| top.max(block.top));
        }
    }

    /// Adds what a ray meets up to the distance `end`, nearest first, until the pulse is used up.
    ///
    /// `Hit::part` can be passed to [`World::part`] until the world advances.
    pub(super) fn cast(&self, ray: &Ray, end: f64, random: &mut Random, hits: &mut Vec<Hit>) {
        let Some(mut walk) = Walk::new(ray, self.top, end) else { return };
        let mut energy = 1.0;
        while energy > SPENT && walk.from < walk.end {
            let until = walk.leave();
            if let Some((slot, block)) = self.block(walk.cell[0]) {
                let before = hits.len();
                let (enters, leaves) = (ray.at(walk.from)[2], ray.at(until)[2]);
                for piece in block.cell(walk.cell[0].rem_euclid(COLUMNS), row_of(walk.cell[1])) {
                    if piece.high > enters.min(leaves) && piece.low < enters.max(leaves) {
                        let part = piece.part * BLOCK_SLOTS + slot;
                        let shape = &block.parts[piece.part].part.shape;
                        shape.hit(ray, [walk.from, until], random, |hit| hits.push(Hit { part, ..hit }));
                    }
                }
                let found = &mut hits[before..];
                found.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.part.cmp(&b.part)));
                energy *= found.iter().map(|hit| 1.0 - hit.coverage).product::<f64>();
            }
            walk.step();
        }
    }

    /// The part that a hit is on.
    pub(super) fn part(&self, hit: &Hit) -> Option<&PlacedPart> {
        self.blocks.get(hit.part % BLOCK_SLOTS)?.parts.get(hit.part / BLOCK_SLOTS)
    }

    fn block(&self, column: i64) -> Option<(usize, &Block)> {
        let slot = usize::try_from(column.div_euclid(COLUMNS) - self.first).ok()?;
        Some((slot, self.blocks.get(slot)?))
    }
}

/// More than the blocks ever in sight, so that part and block share one number.
const BLOCK_SLOTS: usize = 8;

fn count(length: usize) -> i64 {
    i64::try_from(length).unwrap_or(i64::MAX)
}

impl Block {
    fn build(layout: &impl Layout, number: i64) -> Self {
        let mut parts = Vec::new();
        let mut placed: Vec<(usize, InCell)> = Vec::new();
        let mut top = f64::NEG_INFINITY;
        for block in number - 1..=number + 1 {
            for (ordinal, object) in layout.objects(block).into_iter().enumerate() {
                let (object_id, ground) = (object_id(block, ordinal), object.ground);
                for part in object.parts {
                    let before = placed.len();
                    for piece in part.shape.pieces() {
                        let piece = piece.grown(WIDEST_FOOTPRINT);
                        let in_cell = InCell { part: parts.len(), low: piece.low[2], high: piece.high[2] };
                        placed.extend(cells(number, &piece).map(|cell| (cell, in_cell)));
                    }
                    if placed.len() > before {
                        top = top.max(part.shape.bounds().high[2] + WIDEST_FOOTPRINT);
                        parts.push(PlacedPart { part, object_id, ground });
                    }
                }
            }
        }
        placed.sort_unstable_by_key(|(cell, piece)| (*cell, piece.part));
        placed.dedup_by(|(cell, piece), (kept_cell, kept)| {
            // Pieces of one wire share cells.
            let is_same = cell == kept_cell && piece.part == kept.part;
            if is_same {
                (kept.low, kept.high) = (kept.low.min(piece.low), kept.high.max(piece.high));
            }
            is_same
        });
        let cells = COLUMNS * ROWS;
        let starts = (0..=cells).map(|cell| placed.partition_point(|(at, _)| count(*at) < cell)).collect();
        Self { parts, starts, in_cells: placed.into_iter().map(|(_, piece)| piece).collect(), top }
    }

    /// The parts that reach into a cell.
    fn cell(&self, column: i64, row: i64) -> &[InCell] {
        let cell = usize::try_from(row * COLUMNS + column).ok().filter(|_| (0..ROWS).contains(&row));
        let range = cell.and_then(|cell| Some(*self.starts.get(cell)?..*self.starts.get(cell + 1)?));
        range.and_then(|range| self.in_cells.get(range)).unwrap_or_default()
    }
}

/// Rows are counted from the right edge of the grid, cells from the track.
const fn row_of(cell: i64) -> i64 {
    cell + ROWS / 2
}

/// The cells of a block that a box reaches into.
fn cells(block: i64, bounds: &Bounds) -> impl Iterator<Item = usize> {
    let first_column = block * COLUMNS;
    let columns = cell_of(bounds.low[0]).max(first_column)..=cell_of(bounds.high[0]).min(first_column + COLUMNS - 1);
    let (low, high) = (row_of(cell_of(bounds.low[1])).max(0), row_of(cell_of(bounds.high[1])).min(ROWS - 1));
    columns.flat_map(move |column| {
        (low..=high).filter_map(move |row| usize::try_from(row * COLUMNS + column - first_column).ok())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::unit;
    use crate::scene::road::Street;
    use crate::scene::shape::Shape;
    use crate::scene::village::Village;

    /// A layout without leaves, which are met by chance.
    struct Bare<L>(L);

    impl<L: Layout> Layout for Bare<L> {
        fn objects(&self, block: i64) -> Vec<Object> {
            let mut objects = self.0.objects(block);
            for object in &mut objects {
                object.parts.retain(|part| !matches!(part.shape, Shape::Crown(_)));
            }
            objects
        }
    }

    /// Distance and object of the nearest opaque hit.
    fn nearest(hits: impl Iterator<Item = (Hit, i64)>) -> Option<(f64, i64)> {
        let opaque = hits.filter(|(hit, _)| hit.coverage > 0.99).map(|(hit, id)| (hit.distance, id));
        opaque.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn check_against_all_parts(layout: impl Layout, aim: impl Fn(&mut Random) -> Ray, seed: u64) {
        let mut world = World::new(Bare(layout));
        world.advance(300.0);
        let parts: Vec<(i64, Object)> = (0..5)
            .flat_map(|block| {
                world
                    .layout
                    .objects(block)
                    .into_iter()
                    .enumerate()
                    .map(move |(ordinal, object)| (object_id(block, ordinal), object))
            })
            .collect();
        let mut random = Random::at(seed, 0, 0);
        let mut met = 0;
        for _ in 0..2000 {
            let ray = aim(&mut random);
            let mut hits = Vec::new();
            world.cast(&ray, 60.0, &mut random, &mut hits);
            let in_grid = nearest(hits.iter().filter_map(|hit| Some((*hit, world.part(hit)?.object_id))));
            let mut all = Vec::new();
            for (id, object) in &parts {
                for part in &object.parts {
                    part.shape.hit(&ray, [0.0, 60.0], &mut random, |hit| all.push((hit, *id)));
                }
            }
            let by_force = nearest(all.into_iter());
            assert_eq!(in_grid.map(|hit| hit.1), by_force.map(|hit| hit.1), "{ray:?}");
            met += usize::from(in_grid.is_some());
        }
        assert!(met > 200, "{met} rays met something");
    }

    #[test]
    fn the_grid_finds_what_a_search_through_all_parts_finds() {
        let street = Street::new(3);
        let from_van = |random: &mut Random| {
            let mut origin = street.beside(random.between(290.0, 310.0), -1.6).origin;
            origin[2] += 2.4;
            let direction = [random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-0.1, 0.8)];
            Ray { origin, direction: unit(direction), aperture: 0.002, spread: 1.5e-4 }
        };
        check_against_all_parts(street, from_van, 1);
        let village = Village::new(3);
        let from_above = |random: &mut Random| {
            let (x, y) = (random.between(260.0, 340.0), random.between(-90.0, 90.0));
            let direction = [random.between(-0.1, 0.1), random.between(-0.4, 0.4), -1.0];
            Ray { origin: [x, y, village.ground(x, y) + 40.0], direction: unit(direction), aperture: 0.1, spread: 0.0 }
        };
        check_against_all_parts(village, from_above, 2);
    }

    #[test]
    fn few_blocks_are_kept_however_far_the_scanner_gets() {
        let mut world = World::new(Village::new(1));
        for step in 0..200 {
            world.advance(f64::from(step) * 50.0);
            assert!(world.blocks.len() <= 3, "{} blocks", world.blocks.len());
        }
        assert!(world.first > 60);
    }

    fn check_reach(layout: &impl Layout) {
        for block in 0..40 {
            let objects = layout.objects(block);
            assert!(count(objects.len()) < IDS_PER_BLOCK);
            for object in objects {
                let bounds = object.bounds();
                assert!(bounds.low[0] > start_of(block - 1) && bounds.high[0] < start_of(block + 2), "{bounds:?}");
                assert!(bounds.low[1].abs().max(bounds.high[1].abs()) < 128.0, "{bounds:?}");
            }
        }
    }

    #[test]
    fn no_object_reaches_beyond_the_next_block_or_off_the_grid() {
        check_reach(&Village::new(11));
        check_reach(&Street::new(11));
    }
}
