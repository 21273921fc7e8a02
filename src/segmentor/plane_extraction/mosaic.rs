//! Planes of all tiles put together: patches of neighboring tiles that share points and agree are one segment.

use std::collections::BTreeSet;

use super::Plane;
use super::growth::Patch;
use crate::label::{Labels, NONE};
use crate::neighborhood::Grid;
use crate::union_find::UnionFind;

/// The patches of a window.
pub(super) struct Mosaic {
    /// The patch of each point, of those grown in its own tile.
    patches: Vec<i64>,
    planes: Vec<Plane>,
    /// Points that a patch has taken in beyond its own tile.
    beyond: Vec<(u32, u32)>,
}

impl Mosaic {
    pub(super) fn new(points: usize) -> Self {
        Self { patches: vec![NONE; points], planes: Vec::new(), beyond: Vec::new() }
    }

    /// Takes in a patch that was grown in a tile. One that has no point in it is left to the neighboring tiles.
    pub(super) fn take_in(&mut self, patch: Patch, is_in_tile: impl Fn(u32) -> bool) {
        let number = self.planes.len();
        let (own, beyond): (Vec<u32>, Vec<u32>) = patch.points.into_iter().partition(|&point| is_in_tile(point));
        if own.is_empty() {
            return;
        }
        for point in own {
            self.patches[point as usize] = number as i64;
        }
        self.beyond.extend(beyond.into_iter().map(|point| (point, number as u32)));
        self.planes.push(patch.plane);
    }

    /// The plane of a point's patch.
    pub(super) fn plane_of(&self, point: u32) -> &Plane {
        &self.planes[self.patches[point as usize] as usize]
    }

    /// Patches of two tiles that share a point next to both.
    fn pairs(&self, grid: &Grid<'_>) -> BTreeSet<[u32; 2]> {
        let mut pairs = BTreeSet::new();
        let mut found = Vec::new();
        for &(point, patch) in &self.beyond {
            let other = self.patches[point as usize];
            if other == NONE || pairs.contains(&[patch, other as u32]) {
                continue;
            }
            // Pairs farther apart than neighbors are might not be seen by any window.
            grid.neighbors(point, &mut found);
            if found.iter().any(|neighbor| self.patches[neighbor.point as usize] == i64::from(patch)) {
                pairs.insert([patch, other as u32]);
            }
        }
        pairs
    }

    /// One label for the patches that hold together.
    pub(super) fn labels(&self, grid: &Grid<'_>, agree: impl Fn(&Plane, &Plane) -> bool) -> Labels {
        let mut sets = UnionFind::new(self.planes.len());
        for [a, b] in self.pairs(grid) {
            if agree(&self.planes[a as usize], &self.planes[b as usize]) {
                sets.union(a, b);
            }
        }
        let representatives = sets.into_representatives();
        let label = |&patch: &i64| if patch == NONE { NONE } else { i64::from(representatives[patch as usize]) };
        Labels::from_any(&self.patches.iter().map(label).collect::<Vec<i64>>())
    }
}
