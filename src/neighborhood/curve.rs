//! Orders points along Hilbert's curve (1891), so that points near each other in the plane are mostly near each other
//! in memory and in time. Both the triangulation and union-find live on that.

/// Bits per axis of a curve position. Key and point number share one word, which sorts fastest.
const BITS: u32 = 16;

/// The numbers of `points` in the order of the curve; points with equal coordinates are consecutive, in ascending order
/// of `height` and then of number.
pub(super) fn curve_order(points: &[[f64; 2]], height: impl Fn(u32) -> f64) -> Vec<u32> {
    let place = Place::new(points);
    let mut keys: Vec<u64> = (0u64..).zip(points).map(|(i, point)| place.on_curve(point) << 32 | i).collect();
    keys.sort_unstable();
    let mut order: Vec<u32> = keys.iter().map(|key| *key as u32).collect();
    sort_within_cells(&keys, &mut order, points, height);
    order
}

/// A cell of the curve may hold different points in any order: sort each cell so that equal ones come together.
fn sort_within_cells(keys: &[u64], order: &mut [u32], points: &[[f64; 2]], height: impl Fn(u32) -> f64) {
    let mut start = 0;
    for cell in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
        if cell.len() > 1 {
            order[start..start + cell.len()].sort_unstable_by(|&a, &b| {
                let (p, q) = (points[a as usize], points[b as usize]);
                p[0].total_cmp(&q[0])
                    .then_with(|| p[1].total_cmp(&q[1]))
                    .then_with(|| height(a).total_cmp(&height(b)))
                    .then_with(|| a.cmp(&b))
            });
        }
        start += cell.len();
    }
}

/// Maps the bounding square of some points onto the curve's grid.
struct Place {
    low: [f64; 2],
    cells_per_unit: f64,
}

impl Place {
    fn new(points: &[[f64; 2]]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            for k in 0..2 {
                low[k] = low[k].min(point[k]);
                high[k] = high[k].max(point[k]);
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        let cells = f64::from((1u32 << BITS) - 1);
        // A tiny extent may overflow the quotient; all points are then one cell, which is sorted anyway.
        let cells_per_unit = Some(cells / extent).filter(|c| c.is_finite()).unwrap_or(0.0);
        Self { low, cells_per_unit }
    }

    #[inline]
    fn on_curve(&self, point: &[f64; 2]) -> u64 {
        let cell = |k: usize| ((point[k] - self.low[k]) * self.cells_per_unit) as u32;
        hilbert(cell(0), cell(1))
    }
}

/// Distance along the curve of the grid cell (x, y): quadrant by quadrant, turning and mirroring the rest so that the
/// curve enters each quadrant where it left the last.
#[inline]
fn hilbert(mut x: u32, mut y: u32) -> u64 {
    let mut distance = 0;
    for bit in (0..BITS).rev() {
        let (right, up) = (x >> bit & 1, y >> bit & 1);
        distance = distance << 2 | u64::from((3 * right) ^ up);
        if up == 0 {
            if right == 1 {
                (x, y) = (!x, !y);
            }
            (x, y) = (y, x);
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_steps_from_cell_to_neighbouring_cell() {
        // The first 4⁴ places of the curve fill the square of 16 × 16 cells at the origin.
        let mut cells = vec![None; 256];
        for x in 0..16 {
            for y in 0..16 {
                let place = hilbert(x, y) as usize;
                assert!(cells[place].replace((x, y)).is_none());
            }
        }
        let cells: Vec<(u32, u32)> = cells.into_iter().flatten().collect();
        assert!(cells.windows(2).all(|c| c[0].0.abs_diff(c[1].0) + c[0].1.abs_diff(c[1].1) == 1));
    }

    #[test]
    fn equal_points_are_consecutive_by_height_then_number() {
        let points = [[5.0, 5.0], [0.0, 0.0], [5.0, 5.0], [9.0, 9.0], [5.0, 5.0]];
        let heights = [3.0, 0.0, 1.0, 0.0, 1.0];
        let order = curve_order(&points, |i| heights[i as usize]);
        let at = order.iter().position(|&i| i == 2).unwrap();
        assert_eq!(order[at..at + 3], [2, 4, 0]);
        assert_eq!(order.len(), 5);
    }

    #[test]
    fn no_point_one_point_and_equal_points_are_fine() {
        assert!(curve_order(&[], |_| 0.0).is_empty());
        assert_eq!(curve_order(&[[3.0, 4.0]], |_| 0.0), [0]);
        assert_eq!(curve_order(&[[3.0, 4.0]; 3], |_| 0.0), [0, 1, 2]);
        assert_eq!(curve_order(&[[0.0, 0.0], [1e-310, 0.0]], |_| 0.0).len(), 2);
    }
}
