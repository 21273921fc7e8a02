//! The way of a ray through a square grid, from cell to cell.
//!
//! Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987,
//! doi:10.2312/egtp.19871000, in the plane: the ray crosses borders between columns and borders between rows at equal
//! distances each, and the next border is the nearer of the two.

use super::geometry::Ray;

/// Edge of a cell, metres.
pub(super) const CELL: f64 = 4.0;

/// The number of the cell that a coordinate lies in.
pub(super) fn cell_of(coordinate: f64) -> i64 {
    (coordinate / CELL).floor() as i64
}

/// The way of a ray from cell to cell.
#[derive(Clone, Debug)]
pub(super) struct Walk {
    /// The cell that the ray is in, along and across the track.
    pub(super) cell: [i64; 2],
    /// Distance at which it entered, metres.
    pub(super) from: f64,
    /// Distance at which the walk ends, metres.
    pub(super) end: f64,
    /// Distance at which the ray next crosses a border between columns and between rows, and from one to the next.
    border: [f64; 2],
    stride: [f64; 2],
    step: [i64; 2],
}

impl Walk {
    /// The way of a ray below the height `top`, up to the distance `end`.
    pub(super) fn new(ray: &Ray, top: f64, end: f64) -> Option<Self> {
        let (height, climb) = (ray.origin[2], ray.direction[2]);
        let crossing = (top - height) / climb;
        let (from, end) = if height > top {
            if climb >= 0.0 {
                return None;
            }
            (crossing, end)
        } else {
            (0.0, if climb > 0.0 { end.min(crossing) } else { end })
        };
        let start = ray.at(from);
        let cell = [cell_of(start[0]), cell_of(start[1])];
        let mut walk = Self { cell, from, end, border: [f64::INFINITY; 2], stride: [f64::INFINITY; 2], step: [0; 2] };
        for axis in 0..2 {
            let slope = ray.direction[axis];
            if slope != 0.0 {
                walk.step[axis] = if slope > 0.0 { 1 } else { -1 };
                walk.stride[axis] = CELL / slope.abs();
                let next = (cell[axis] + i64::from(slope > 0.0)) as f64 * CELL;
                walk.border[axis] = from + (next - start[axis]) / slope;
            }
        }
        Some(walk)
    }

    /// Distance at which the ray leaves the cell, metres.
    pub(super) fn leave(&self) -> f64 {
        self.border[0].min(self.border[1]).min(self.end)
    }

    /// Enters the next cell.
    pub(super) fn step(&mut self) {
        self.from = self.leave();
        if self.border[0] <= self.border[1] {
            self.cell[0] += self.step[0];
            self.border[0] += self.stride[0];
        } else {
            self.cell[1] += self.step[1];
            self.border[1] += self.stride[1];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::unit;

    #[test]
    fn every_stretch_lies_in_its_cell_and_none_is_left_out() {
        for step in 0..64 {
            let direction = unit([f64::from(step % 8) - 3.5, f64::from(step / 8) - 4.0, -0.3]);
            let ray = Ray { origin: [13.0, -7.5, 50.0], direction, aperture: 0.0, spread: 0.0 };
            let mut walk = Walk::new(&ray, 45.0, 90.0).expect("the ray goes down");
            let mut reached = walk.from;
            assert!((ray.at(reached)[2] - 45.0).abs() < 1e-9);
            while walk.from < walk.end {
                assert!(walk.from == reached && walk.leave() >= walk.from);
                let middle = ray.at(0.5 * (walk.from + walk.leave()));
                let is_inside = (0..2).all(|axis| cell_of(middle[axis]) == walk.cell[axis]);
                assert!(is_inside || walk.leave() - walk.from < 1e-9);
                reached = walk.leave();
                walk.step();
            }
            assert!(reached == 90.0);
        }
    }
}
