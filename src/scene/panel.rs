//! A flat convex face: the sides and roofs of houses, the skin of cars, signs. Facades may have windows set back in them.

use super::geometry::{Bounds, Ray, Vector, add, between, cross, dot, scale, subtract, unit};
use super::shape::Hit;

/// Share of a wall's reflectance that a window pane sends back.
const PANE_BRIGHTNESS: f64 = 0.25;
/// How far outside a closed edge a point may lie and still count as inside, metres: closes the seams between panels.
const SEAM: f64 = 1e-6;

/// A convex quadrilateral; a triangle repeats one corner.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    corners: [Vector; 4],
    normal: Vector,
    edges: [Edge; 4],
    windows: Option<Box<Windows>>,
}

/// One side of a panel.
#[derive(Clone, Copy, Debug)]
struct Edge {
    /// In the plane of the panel, perpendicular to the edge, pointing inward.
    inward: Vector,
    /// Of the edge, along `inward`.
    offset: f64,
    /// Nothing adjoins here, so that a pulse can graze the edge and go on.
    is_free: bool,
}

/// Rows and columns of windows in an upright panel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Windows {
    /// Lower corner of the grid of windows.
    pub(super) origin: Vector,
    /// Horizontal unit direction of the rows.
    pub(super) along: Vector,
    /// Unit direction into the building.
    pub(super) inward: Vector,
    /// Distance between neighbouring windows, along and up, metres.
    pub(super) pitch: [f64; 2],
    /// Width and height of one window, metres.
    pub(super) size: [f64; 2],
    /// Number of columns and rows.
    pub(super) count: [f64; 2],
    /// How far the panes are set back, metres.
    pub(super) depth: f64,
}

impl Panel {
    /// A panel from its corners in order around it; `is_free[i]` speaks of the edge from corner `i` to the next.
    pub(super) fn new(corners: [Vector; 4], is_free: [bool; 4]) -> Self {
        let normal = unit(cross(subtract(corners[2], corners[0]), subtract(corners[3], corners[1])));
        let middle = between(between(corners[0], corners[2], 0.5), between(corners[1], corners[3], 0.5), 0.5);
        let edge = |start: usize| {
            let (from, to) = (corners[start], corners[(start + 1) % 4]);
            let across = unit(cross(normal, subtract(to, from)));
            let inward = if dot(across, subtract(middle, from)) < 0.0 { scale(across, -1.0) } else { across };
            // A repeated corner makes an edge without direction; its offset of -1 lies behind every point.
            let offset = if dot(inward, inward) > 0.5 { dot(inward, from) } else { -1e3 };
            Edge { inward, offset, is_free: is_free[start] }
        };
        Self { corners, normal, edges: [edge(0), edge(1), edge(2), edge(3)], windows: None }
    }

    /// The same panel with windows.
    pub(super) fn with_windows(mut self, windows: Windows) -> Self {
        self.windows = Some(Box::new(windows));
        self
    }

    /// The smallest box around the panel and its panes.
    pub(super) fn bounds(&self) -> Bounds {
        let bounds = Bounds::around(&self.corners);
        self.windows.as_ref().map_or(bounds, |windows| bounds.grown(windows.depth))
    }

    /// Where a ray meets the panel, if it does so between the two distances.
    pub(super) fn hit(&self, ray: &Ray, from: f64, to: f64) -> Option<Hit> {
        let approach = dot(ray.direction, self.normal);
        if approach.abs() < 1e-9 {
            return None;
        }
        let distance = dot(subtract(self.corners[0], ray.origin), self.normal) / approach;
        if !(from..to).contains(&distance) {
            return None;
        }
        let point = ray.at(distance);
        let footprint = ray.footprint(distance);
        let mut coverage: f64 = 1.0;
        for edge in &self.edges {
            let inside = dot(edge.inward, point) - edge.offset;
            if edge.is_free {
                coverage = coverage.min((inside + footprint) / (2.0 * footprint));
            } else if inside < -SEAM {
                return None;
            }
        }
        if coverage <= 0.0 {
            return None;
        }
        let wall = Hit { distance, coverage, cosine: approach.abs(), brightness: 1.0, part: 0 };
        Some(self.windows.as_ref().map_or(wall, |windows| windows.set_back(ray, wall)))
    }
}

impl Windows {
    /// Moves a hit that falls into a window to its pane, sill or jamb.
    fn set_back(&self, ray: &Ray, wall: Hit) -> Hit {
        let local = subtract(ray.at(wall.distance), self.origin);
        let at_wall = [dot(local, self.along), local[2]];
        let Some(middle) = self.middle_of_window(at_wall) else {
            return wall;
        };
        let approach = dot(ray.direction, self.inward);
        if approach < 1e-3 {
            return wall;
        }
        let pane_distance = wall.distance + self.depth / approach;
        let beyond = add(local, scale(ray.direction, pane_distance - wall.distance));
        let at_pane = [dot(beyond, self.along), beyond[2]];
        // Share of the way from wall to pane at which the ray meets the side of the recess.
        let mut share: f64 = 1.0;
        for axis in 0..2 {
            let (start, end) = (at_wall[axis] - middle[axis], at_pane[axis] - middle[axis]);
            let side = self.size[axis] / 2.0;
            if end.abs() > side {
                share = share.min((side.copysign(end) - start) / (end - start));
            }
        }
        if share < 1.0 {
            return Hit { distance: wall.distance + share * (pane_distance - wall.distance), ..wall };
        }
        Hit { distance: pane_distance, brightness: PANE_BRIGHTNESS, ..wall }
    }

    /// The middle of the window around a position in the wall, both as metres along and up from the origin.
    fn middle_of_window(&self, position: [f64; 2]) -> Option<[f64; 2]> {
        let mut middle = [0.0; 2];
        for axis in 0..2 {
            let number = (position[axis] / self.pitch[axis]).floor();
            middle[axis] = (number + 0.5) * self.pitch[axis];
            let is_inside = (position[axis] - middle[axis]).abs() < self.size[axis] / 2.0;
            if number < 0.0 || number >= self.count[axis] || !is_inside {
                return None;
            }
        }
        Some(middle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn down(x: f64, y: f64) -> Ray {
        Ray { origin: [x, y, 10.0], direction: [0.0, 0.0, -1.0], aperture: 0.1, spread: 0.0 }
    }

    #[test]
    fn a_free_edge_takes_part_of_the_pulse_and_a_closed_one_all_or_nothing() {
        let square = [[0.0, 0.0, 2.0], [4.0, 0.0, 2.0], [4.0, 4.0, 2.0], [0.0, 4.0, 2.0]];
        let panel = Panel::new(square, [true, false, false, false]);
        let coverage = |x, y| panel.hit(&down(x, y), 0.0, 20.0).map(|hit| hit.coverage);
        assert_eq!(coverage(2.0, 2.0), Some(1.0));
        assert!((coverage(2.0, 0.0).expect("on the free edge") - 0.5).abs() < 1e-12);
        assert_eq!(coverage(3.99, 2.0), Some(1.0));
        assert_eq!(coverage(4.01, 2.0), None);
        assert_eq!(panel.hit(&down(2.0, 2.0), 0.0, 8.0).map(|hit| hit.distance), None);
    }

    #[test]
    fn a_triangle_repeats_a_corner() {
        let triangle = Panel::new([[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 4.0, 0.0]], [false; 4]);
        assert!(triangle.hit(&down(1.0, 1.0), 0.0, 20.0).is_some());
        assert!(triangle.hit(&down(3.0, 3.0), 0.0, 20.0).is_none());
    }

    #[test]
    fn a_window_is_set_back_and_its_jamb_is_hit_at_a_slant() {
        let wall = [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 0.0, 3.0], [0.0, 0.0, 3.0]];
        let (along, inward) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let grid =
            Windows { origin: [0.0; 3], along, inward, pitch: [3.0; 2], size: [1.0; 2], count: [2.0, 1.0], depth: 0.2 };
        let panel = Panel::new(wall, [false; 4]).with_windows(grid);
        let straight = |x| Ray { origin: [x, -5.0, 1.5], direction: [0.0, 1.0, 0.0], aperture: 0.0, spread: 0.0 };
        let depth = |ray: &Ray| panel.hit(ray, 0.0, 20.0).map(|hit| ray.at(hit.distance)[1]);
        assert!((depth(&straight(1.5)).expect("a pane") - 0.2).abs() < 1e-12);
        assert!(depth(&straight(0.5)).expect("the wall").abs() < 1e-12);
        let slanted =
            Ray { origin: [1.9 - 5.0, -5.0, 1.5], direction: unit([1.0, 1.0, 0.0]), aperture: 0.0, spread: 0.0 };
        assert!((depth(&slanted).expect("the jamb") - 0.1).abs() < 1e-9);
    }
}
