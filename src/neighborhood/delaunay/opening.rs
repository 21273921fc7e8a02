//! Where a point would have to lie to give an open place further neighbors.
//!
//! A place strictly between the ends of a straight part of the hull, all of whose triangles are final, has two neighbors on the
//! hull, one on either side along it. Only a point strictly beyond the line can change that: one on the line, between the
//! ends, would lie in the circle of a final triangle, and one that prolongs the line is farther away than a neighbor. The same
//! holds for a place between others on one line, if there are no others, and the edges on either side are final; but then
//! there are two sides.

use robust::{Coord, orient2d};

/// Where a point would have to lie to give a place further neighbors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Opening {
    /// Anywhere outside of what was loaded.
    Anywhere,
    /// Strictly to the left of the line from one place to another, beyond a straight part of the hull.
    LeftOf([[f64; 2]; 2]),
    /// Strictly to either side of the line through two places, on which all places lie.
    Beside([[f64; 2]; 2]),
}

impl Opening {
    /// Whether the opening leaves room for `place`.
    pub fn holds(&self, place: [f64; 2]) -> bool {
        match *self {
            Self::Anywhere => true,
            Self::LeftOf([a, b]) => turn(a, b, place) > 0.0,
            Self::Beside([a, b]) => turn(a, b, place) != 0.0,
        }
    }

    /// Whether both are beyond the same line of one cloud.
    pub fn is_beyond_the_line_of(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::LeftOf([a, b]), Self::LeftOf(line)) | (Self::Beside([a, b]), Self::Beside(line)) => {
                line.iter().all(|place| turn(*a, *b, *place) == 0.0)
            }
            _ => false,
        }
    }
}

/// A number for a vertex, and its place.
pub(super) type Vertex = (usize, [f64; 2]);

/// The straight parts of a convex hull of at least three places, each from corner to corner.
pub(super) fn straight_parts(mut hull: Vec<Vertex>) -> Vec<Vec<Vertex>> {
    let count = hull.len();
    let is_corner = |i: &usize| turn(hull[(i + count - 1) % count].1, hull[*i].1, hull[(i + 1) % count].1) != 0.0;
    let mut corners: Vec<usize> = (0..count).filter(is_corner).collect();
    let first = corners[0];
    corners.push(first + count);
    hull.extend_from_within(..=first);
    corners.windows(2).map(|ends| hull[ends[0]..=ends[1]].to_vec()).collect()
}

/// Above 0 if `c` lies to the left of the line from `a` to `b`, 0 if it lies on it, exactly (Shewchuk 1997).
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    let [a, b, c] = [a, b, c].map(|[x, y]| Coord { x, y });
    orient2d(a, b, c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::neighborhood::{Delaunay, Loaded};

    /// The openings of all open places below a border far above, by place.
    fn openings(places: &[[f64; 2]], high: f64) -> Vec<([f64; 2], Opening)> {
        let neighbors = Delaunay::new(places, |_| 0.0);
        let loaded = Loaded { direction: [1.0, 0.0], low: f64::NEG_INFINITY, high, largest: 0.0 };
        let mut found = Vec::new();
        neighbors.for_each_open_stack(&neighbors.finality(loaded), |stack, opening| {
            found.push((places[neighbors.order()[stack.start] as usize], opening));
        });
        found
    }

    #[test]
    fn between_the_corners_of_a_grid_only_what_lies_beyond_an_edge_matters() {
        let grid: Vec<[f64; 2]> = (0..30).map(|i| [f64::from(i % 6), f64::from(i / 6)]).collect();
        let found = openings(&grid, 100.0);
        assert_eq!(found.len(), 2 * 6 + 2 * 3, "the hull is open");
        for ([x, y], opening) in found {
            let is_corner = (x == 0.0 || x == 5.0) && (y == 0.0 || y == 4.0);
            assert_eq!(opening == Opening::Anywhere, is_corner, "{x} {y}");
            let outside = [2.0 * x - 2.5, 2.0 * y - 2.0];
            assert!(opening.holds(outside) && (is_corner || !opening.holds([2.5, 2.0])));
            assert!(is_corner || !opening.holds([x, y]), "the line itself is not beyond");
        }
    }

    #[test]
    fn what_is_near_the_border_is_open_anywhere() {
        let grid: Vec<[f64; 2]> = (0..200).map(|i| [f64::from(i % 40), f64::from(i / 40)]).collect();
        let found = openings(&grid, 39.1);
        assert!(found.iter().all(|([x, _], opening)| *x < 39.0 || *opening == Opening::Anywhere));
        assert!(found.iter().any(|([x, _], opening)| *x > 30.0 && *opening != Opening::Anywhere));
    }

    #[test]
    fn a_line_has_two_sides() {
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(2 * i), f64::from(i)]).collect();
        for ([x, y], opening) in openings(&line, 100.0) {
            assert_eq!(opening == Opening::Anywhere, x == 0.0 || x == 16.0);
            assert!(opening.holds([x, y + 1e-9]) && opening.holds([x, y - 1e-9]));
            assert!(opening == Opening::Anywhere || !opening.holds([200.0, 100.0]));
        }
    }
}
