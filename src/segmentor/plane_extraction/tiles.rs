//! Tiles of the map, anchored at absolute zero, and what lies around each.
//!
//! What is grown in a tile depends on the tile and its margin alone, and so on no window: any that holds them grows the
//! same.

use std::collections::BTreeMap;

use crate::window::Window;

/// The number of a tile along x and y.
pub(super) type Tile = [i64; 2];

/// The points of a window by tile.
pub(super) struct Tiles<'a> {
    window: &'a Window,
    size: f64,
    margin: f64,
    cores: BTreeMap<Tile, Vec<u32>>,
}

impl<'a> Tiles<'a> {
    /// Sorts the window's points into tiles with sides of `size`, whose surroundings are `margin` wide.
    pub(super) fn new(window: &'a Window, size: f64, margin: f64) -> Self {
        let mut tiles = Self { window, size, margin, cores: BTreeMap::new() };
        for point in 0..window.points().len() as u32 {
            tiles.cores.entry(tiles.tile(point)).or_default().push(point);
        }
        tiles
    }

    /// The tiles that hold a point, with their points.
    pub(super) fn iter(&self) -> impl Iterator<Item = (Tile, &[u32])> {
        self.cores.iter().map(|(&tile, core)| (tile, core.as_slice()))
    }

    fn position(&self, point: u32) -> [f64; 2] {
        let [x, y, _] = self.window.lattice().real(&self.window.points()[point as usize]);
        [x, y]
    }

    /// The tile that the point lies in.
    pub(super) fn tile(&self, point: u32) -> Tile {
        self.position(point).map(|c| (c / self.size).floor() as i64)
    }

    /// The borders of a tile with its margin along one axis.
    fn borders(&self, number: i64) -> [f64; 2] {
        [number as f64 * self.size - self.margin, (number as f64 + 1.0) * self.size + self.margin]
    }

    /// Whether the tile, its margin, and what lies within `radius` of them have been loaded.
    pub(super) fn is_loaded(&self, tile: Tile, radius: f64) -> bool {
        let (scale, offset) = (self.window.lattice().scale(), self.window.lattice().offset());
        let [xs, ys] = tile.map(|number| self.borders(number));
        xs.iter().all(|x| {
            let holds = |y| self.window.holds(&[(x - offset[0]) / scale[0], (y - offset[1]) / scale[1], 0.0], radius);
            ys.iter().all(holds)
        })
    }

    /// The points of a tile and of its margin.
    pub(super) fn surroundings(&self, tile: Tile) -> Vec<u32> {
        let borders = tile.map(|number| self.borders(number));
        let is_inside =
            |&point: &u32| self.position(point).iter().zip(borders).all(|(c, [low, high])| low <= *c && *c < high);
        let mut points = self.cores.get(&tile).cloned().unwrap_or_default();
        for neighbor in around(tile) {
            points.extend(self.cores.get(&neighbor).into_iter().flatten().copied().filter(is_inside));
        }
        points
    }
}

/// The up to eight tiles around a tile.
fn around([x, y]: Tile) -> impl Iterator<Item = Tile> {
    let steps = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [dx, dy])).filter(|step| *step != [0, 0]);
    steps.filter_map(move |[dx, dy]| Some([x.checked_add(dx)?, y.checked_add(dy)?]))
}
