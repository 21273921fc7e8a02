//! Points sorted into the cells of a grid, and a pyramid of boxes by which a search finds the cells near a place.
//!
//! 1. The points are sorted by counting (Seward 1954) into the cells of a grid, the cells in the order of Morton's curve
//!    (1966). A cell that is left with more points than a block gets a grid of its own, so neither a stray point far away
//!    nor a density that varies a thousandfold spoils the order, and nothing is kept for empty cells.
//! 2. [`BLOCK`] consecutive points are a block, stored axis by axis, which compilers turn into vector instructions.
//! 3. Each block has its bounds, so have two consecutive blocks, and so on up to the bounds of everything.
//!
//! Rounding never hides a point: floating-point subtraction and multiplication are monotonic, so the gap between a
//! point and the bounds, computed as distances are, never exceeds the computed distance to a point inside.

use crate::lattice::Within;

/// Points per block.
pub(super) const BLOCK: usize = 16;

/// The coordinates of some consecutive points, axis by axis; NaN where there is no point.
pub(super) type Block = [[f64; BLOCK]; 3];

/// What is known of some consecutive blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub smallest_id: i64,
}

/// The points of a window in the order of their cells.
pub(super) struct Cells {
    /// Their numbers in the window.
    pub order: Vec<u32>,
    pub blocks: Vec<Block>,
    /// First those of the blocks, then of pairs of blocks, of pairs of pairs; one of everything last.
    pub pyramid: Vec<Vec<Bounds>>,
}

impl Cells {
    /// Sorts `points` into cells over the axes that count in `within`.
    pub fn new(points: &[[f64; 3]], point_ids: &[i64], within: &Within) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        sort_into_cells(&mut order, points, &within.weights());
        let mut blocks = Vec::with_capacity(order.len().div_ceil(BLOCK));
        let mut level = Vec::with_capacity(blocks.capacity());
        for numbers in order.chunks(BLOCK) {
            let mut block = [[f64::NAN; BLOCK]; 3];
            let mut bounds = Bounds::NOTHING;
            for (i, &number) in numbers.iter().enumerate() {
                let point = &points[number as usize];
                for k in 0..3 {
                    block[k][i] = point[k];
                }
                bounds = bounds.with(&Bounds::of(point, point_ids[number as usize]));
            }
            blocks.push(block);
            level.push(bounds);
        }
        let mut pyramid = vec![level];
        while let Some(below) = pyramid.last().filter(|below| below.len() > 1) {
            let above = below.chunks(2).map(|pair| pair.iter().fold(Bounds::NOTHING, Bounds::with));
            pyramid.push(above.collect());
        }
        Self { order, blocks, pyramid }
    }

    /// The point at a place of the order.
    #[inline]
    pub fn point(&self, place: u32) -> [f64; 3] {
        let (block, i) = (&self.blocks[place as usize / BLOCK], place as usize % BLOCK);
        block.map(|axis| axis[i])
    }

    /// Calls `visit` for the block `start` and for all others that can hold points within reach of `point`, until
    /// `visit` says no. With `onward`, only for those behind `start` in the order.
    pub fn visit_near(
        &self,
        start: usize,
        onward: bool,
        point: &[f64; 3],
        within: &Within,
        visit: &mut impl FnMut(usize) -> bool,
    ) {
        // From the own block upwards: most of what is near is found at once.
        let mut go_on = visit(start);
        let mut index = start;
        for level in 0..self.pyramid.len() {
            let sibling = index ^ 1;
            if go_on && sibling < self.pyramid[level].len() && (sibling > index || !onward) {
                go_on = self.visit_below(level, sibling, point, within, visit);
            }
            index /= 2;
        }
    }

    fn visit_below(
        &self,
        level: usize,
        index: usize,
        point: &[f64; 3],
        within: &Within,
        visit: &mut impl FnMut(usize) -> bool,
    ) -> bool {
        let bounds = &self.pyramid[level][index];
        if bounds.are_beyond(bounds.squared_gap(point, &within.weights()), point, within) {
            return true;
        }
        if level == 0 {
            return visit(index);
        }
        self.children(level, index).all(|child| self.visit_below(level - 1, child, point, within, visit))
    }

    /// The parts, one level below, of what lies at `index` on `level`.
    #[inline]
    pub fn children(&self, level: usize, index: usize) -> std::ops::Range<usize> {
        2 * index..(2 * index + 2).min(self.pyramid[level - 1].len())
    }

    /// The places in the order of the points below `index` on `level`.
    #[inline]
    pub fn places(&self, level: usize, index: usize) -> std::ops::Range<u32> {
        let size = BLOCK << level;
        (index * size) as u32..((index + 1) * size).min(self.order.len()) as u32
    }
}

impl Bounds {
    const NOTHING: Bounds = Bounds { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3], smallest_id: i64::MAX };

    #[inline]
    fn of(point: &[f64; 3], id: i64) -> Self {
        Self { low: *point, high: *point, smallest_id: id }
    }

    #[inline]
    fn with(self, other: &Bounds) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
            smallest_id: self.smallest_id.min(other.smallest_id),
        }
    }

    /// The squared distance from `point` to these bounds.
    #[inline]
    pub fn squared_gap(&self, point: &[f64; 3], weights: &[f64; 3]) -> f64 {
        squared(std::array::from_fn(|k| larger(self.low[k] - point[k], point[k] - self.high[k])), weights)
    }

    /// The squared distance between these bounds and others.
    #[inline]
    pub fn squared_gap_between(&self, other: &Bounds, weights: &[f64; 3]) -> f64 {
        squared(std::array::from_fn(|k| larger(self.low[k] - other.high[k], other.low[k] - self.high[k])), weights)
    }

    /// Whether no point inside, which are all at least as far away from `point` as `squared_gap`, is within reach.
    #[inline]
    pub fn are_beyond(&self, squared_gap: f64, point: &[f64; 3], within: &Within) -> bool {
        within.excludes(squared_gap, || (*point, self.largest()))
    }

    /// Whether no pair of points inside and inside others, at least as far apart as `squared_gap`, is within reach.
    #[inline]
    pub fn are_apart(&self, squared_gap: f64, other: &Bounds, within: &Within) -> bool {
        within.excludes(squared_gap, || (other.largest(), self.largest()))
    }

    /// The largest coordinates inside, but for their sign.
    fn largest(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.low[k].abs().max(self.high[k].abs()))
    }
}

/// One instruction, which [`f64::max`] is not.
#[inline]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline]
fn squared(gaps: [f64; 3], weights: &[f64; 3]) -> f64 {
    let d: [f64; 3] = std::array::from_fn(|k| larger(gaps[k], 0.0) * weights[k]);
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// The squared distances from `point` to the points of a block; NaN where there is none.
#[inline]
pub(super) fn squared_distances(point: &[f64; 3], block: &Block, weights: &[f64; 3]) -> [f64; BLOCK] {
    let mut squared = [0.0; BLOCK];
    for k in 0..3 {
        for (squared, coordinate) in squared.iter_mut().zip(&block[k]) {
            let d = (coordinate - point[k]) * weights[k];
            *squared += d * d;
        }
    }
    squared
}

/// One bit for each of the squared distances that is no larger than `limit`.
#[inline]
pub(super) fn up_to(limit: f64, squared: &[f64; BLOCK]) -> Bits {
    Bits((0u32..).zip(squared).fold(0, |bits, (i, &squared)| bits | u32::from(squared <= limit) << i))
}

/// Some points of a block, as an iterator of their numbers in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bits(pub u32);

impl std::ops::BitAnd for Bits {
    type Output = Bits;

    #[inline]
    fn bitand(self, other: Bits) -> Bits {
        Bits(self.0 & other.0)
    }
}

#[allow(clippy::copy_iterator)] // a number: whoever goes through it means to go through a copy
impl Iterator for Bits {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        let lowest = self.0.trailing_zeros();
        self.0 &= self.0.wrapping_sub(1);
        (lowest < u32::BITS).then_some(lowest as usize)
    }
}

/// Sorts the numbers of `points` by cell, and the points of each crowded cell by cells of its own.
fn sort_into_cells(numbers: &mut [u32], points: &[[f64; 3]], weights: &[f64; 3]) {
    if numbers.len() <= BLOCK {
        return;
    }
    let Some(lattice) = CellLattice::around(numbers, points, weights) else { return };
    let key = |&number: &u32| u64::from(lattice.on_curve(&points[number as usize])) << 32 | u64::from(number);
    let mut keys: Vec<u64> = numbers.iter().map(key).collect();
    sort_by_upper_half(&mut keys);
    for (number, key) in numbers.iter_mut().zip(&keys) {
        *number = *key as u32;
    }
    let mut rest = numbers;
    for cell in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
        let (crowded, others) = rest.split_at_mut(cell.len());
        sort_into_cells(crowded, points, weights);
        rest = others;
    }
}

/// Cubic cells, or square ones on the map, over the bounds of some points.
struct CellLattice {
    low: [f64; 3],
    cells_per_unit: [f64; 3],
    flat: bool,
}

impl CellLattice {
    /// None if all points are at one place.
    fn around(numbers: &[u32], points: &[[f64; 3]], weights: &[f64; 3]) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &number in numbers {
            let point = &points[number as usize];
            for k in 0..3 {
                low[k] = low[k].min(point[k]);
                high[k] = high[k].max(point[k]);
            }
        }
        let extent = (0..3).map(|k| (high[k] - low[k]) * weights[k]).fold(0.0, f64::max);
        let flat = weights[2] == 0.0;
        let cells = f64::from((1u32 << bits(flat)) - 1);
        let cells_per_unit = weights.map(|weight| weight * (cells / extent));
        cells_per_unit.iter().all(|c| c.is_finite()).then_some(Self { low, cells_per_unit, flat })
    }

    /// The cell's place on Morton's curve.
    #[inline]
    fn on_curve(&self, point: &[f64; 3]) -> u32 {
        let cell = |k: usize| ((point[k] - self.low[k]) * self.cells_per_unit[k]) as u32;
        if self.flat {
            spread_by_two(cell(0)) | spread_by_two(cell(1)) << 1
        } else {
            spread_by_three(cell(0)) | spread_by_three(cell(1)) << 1 | spread_by_three(cell(2)) << 2
        }
    }
}

/// Bits per axis, so that a place on the curve has no more than 32.
fn bits(flat: bool) -> u32 {
    if flat { 16 } else { 10 }
}

/// Moves the 16 lower bits apart, leaving one bit free between each two.
#[inline]
fn spread_by_two(mut x: u32) -> u32 {
    x = (x | x << 8) & 0x00ff_00ff;
    x = (x | x << 4) & 0x0f0f_0f0f;
    x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}

/// Moves the 10 lower bits apart, leaving two bits free between each two.
#[inline]
fn spread_by_three(mut x: u32) -> u32 {
    x = (x | x << 16) & 0x0300_00ff;
    x = (x | x << 8) & 0x0300_f00f;
    x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}

/// Sorts by the upper 32 bits, in three rounds of counting; equal ones stay in their order.
fn sort_by_upper_half(keys: &mut Vec<u64>) {
    const DIGIT: u32 = 11;
    if keys.len() < 1 << DIGIT {
        // Counting does not pay for a few. Lower halves are in ascending order to begin with.
        keys.sort_unstable();
        return;
    }
    let mut sorted = vec![0; keys.len()];
    for shift in [32, 32 + DIGIT, 32 + 2 * DIGIT] {
        let digit = |key: u64| (key >> shift) as usize % (1 << DIGIT);
        let mut next = [0usize; 1 << DIGIT];
        for &key in keys.iter() {
            next[digit(key)] += 1;
        }
        let mut start = 0;
        for count in &mut next {
            start += std::mem::replace(count, start);
        }
        for &key in keys.iter() {
            let place = &mut next[digit(key)];
            sorted[*place] = key;
            *place += 1;
        }
        std::mem::swap(keys, &mut sorted);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counting_sorts_by_the_upper_half_and_keeps_the_order(upper in prop::collection::vec(any::<u32>(), 2048..5000)) {
            let mut keys: Vec<u64> = (0u64..).zip(&upper).map(|(i, &key)| u64::from(key) << 32 | i).collect();
            let mut expected = keys.clone();
            expected.sort_by_key(|key| key >> 32);
            sort_by_upper_half(&mut keys);
            prop_assert_eq!(keys, expected);
        }

        #[test]
        fn bits_are_spread(x in 0u32..1 << 16) {
            let spread = |by: usize, bits: usize| (0..bits).map(|i| (x >> i & 1) << (by * i)).sum::<u32>();
            prop_assert_eq!(spread_by_two(x), spread(2, 16));
            prop_assert_eq!(spread_by_three(x & 0x3ff), spread(3, 10));
        }
    }

    #[test]
    fn a_stray_point_far_away_does_not_spoil_the_order() {
        let mut points: Vec<[f64; 3]> = (0..4096).map(|i| [f64::from(i % 64), f64::from(i / 64), 0.0]).collect();
        points.push([1e40, -1e50, 1e30]);
        let ids: Vec<i64> = (0..4097).collect();
        let within = Within::new(1.0, crate::lattice::Metric::Xyz, &crate::lattice::Lattice::REAL);
        let cells = Cells::new(&points, &ids, &within);
        let side = |b: &Bounds| (b.high[0] - b.low[0]).max(b.high[1] - b.low[1]);
        let small = cells.pyramid[0].iter().filter(|bounds| side(bounds) <= 16.0).count();
        assert!(small >= 200, "{small} of 257 blocks are small");
    }
}
