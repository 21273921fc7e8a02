//! Polygons on the map.

use robust::{Coord, orient2d};

/// A polygon; its border belongs to it. Where it crosses itself, even–odd decides.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Region {
    corners: Vec<Coord<f64>>,
}

impl Region {
    /// From x y x y …, at least three corners; the last one need not repeat the first.
    pub(super) fn new(coordinates: &[f64]) -> Region {
        Region { corners: coordinates.chunks_exact(2).map(|xy| Coord { x: xy[0], y: xy[1] }).collect() }
    }

    /// Of all corners.
    pub(super) fn coordinates(&self) -> impl Iterator<Item = f64> {
        self.corners.iter().flat_map(|corner| [corner.x, corner.y])
    }

    /// Whether a point lies in the region or on its border; never, if a coordinate is NaN.
    ///
    /// Counts the edges that a ray towards +x crosses, which the exact orientation predicate decides.
    pub(super) fn holds(&self, x: f64, y: f64) -> bool {
        let point = Coord { x, y };
        let mut inside = false;
        let mut previous = self.corners[self.corners.len() - 1];
        for &corner in &self.corners {
            let (low, high) = if previous.y <= corner.y { (previous, corner) } else { (corner, previous) };
            if low.y <= y && y <= high.y {
                let side = orient2d(low, high, point);
                if side == 0.0 && (low.x.min(high.x)..=low.x.max(high.x)).contains(&x) {
                    return true;
                }
                inside ^= y < high.y && side > 0.0;
            }
            previous = corner;
        }
        inside
    }
}
