//! Planes of all tiles put together: patches of neighboring tiles that share points and agree are one segment.
//!
//! A patch may lack the points that held it together, as they were released or lie beyond its tile. Pieces farther apart
//! than neighbors are might not be seen by any one window, so each is a patch of its own, with the plane of the whole.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::Plane;
use super::growth::{Member, Patch};
use crate::label::{Labels, NONE};
use crate::neighborhood::Grid;
use crate::union_find::UnionFind;

/// The patches of a window.
pub(super) struct Mosaic {
    /// The piece of each point, of those grown in its own tile.
    pieces: Vec<i64>,
    /// The plane of each piece.
    planes: Vec<Plane>,
    /// Points that a patch has taken in beyond its own tile, and the pieces of that patch.
    beyond: Vec<(u32, Range<u32>)>,
    /// Points that hold together within one piece.
    connected: UnionFind,
}

impl Mosaic {
    pub(super) fn new(points: usize) -> Self {
        Self { pieces: vec![NONE; points], planes: Vec::new(), beyond: Vec::new(), connected: UnionFind::new(points) }
    }

    /// Takes in a patch that was grown in a tile. One that has no point in it is left to the neighboring tiles.
    pub(super) fn take_in(&mut self, patch: Patch, grid: &Grid<'_>, is_in_tile: impl Fn(u32) -> bool) {
        let first = self.planes.len();
        let (own, beyond): (Vec<Member>, Vec<Member>) =
            patch.points.into_iter().partition(|member| is_in_tile(member.point));
        if own.is_empty() {
            return;
        }
        self.connect(&own, grid);
        let mut numbers = BTreeMap::new();
        for Member { point, .. } in own {
            let next = first + numbers.len();
            self.pieces[point as usize] = *numbers.entry(self.connected.find(point)).or_insert(next) as i64;
        }
        self.planes.resize(first + numbers.len(), patch.plane);
        let pieces = first as u32..self.planes.len() as u32;
        self.beyond.extend(beyond.into_iter().map(|member| (member.point, pieces.clone())));
    }

    /// Connects those of a patch's points that are neighbors.
    fn connect(&mut self, own: &[Member], grid: &Grid<'_>) {
        let patch = self.planes.len() as i64;
        for member in own {
            self.pieces[member.point as usize] = patch;
        }
        let is_own = |pieces: &[i64], point: u32| pieces[point as usize] == patch;
        let (mut children, mut orphans) = (Vec::new(), Vec::new());
        for &Member { point, parent } in own {
            if point != parent && is_own(&self.pieces, parent) {
                self.connected.union(point, parent);
                children.push(point);
            } else {
                orphans.push(point);
            }
        }
        // Mostly nobody, or only orphans, have to be asked for their neighbors.
        let mut left = orphans.len();
        let mut found = Vec::new();
        for point in orphans.into_iter().chain(children) {
            if left == 1 {
                return;
            }
            grid.neighbors(point, &mut found);
            for neighbor in found.iter().filter(|neighbor| is_own(&self.pieces, neighbor.point)) {
                if !self.connected.same(point, neighbor.point) {
                    self.connected.union(point, neighbor.point);
                    left -= 1;
                }
            }
        }
    }

    /// The plane of a point's piece.
    pub(super) fn plane_of(&self, point: u32) -> &Plane {
        &self.planes[self.pieces[point as usize] as usize]
    }

    /// Pieces of two tiles that share a point next to both.
    fn pairs(&self, grid: &Grid<'_>) -> BTreeSet<[u32; 2]> {
        let mut pairs = BTreeSet::new();
        let mut found = Vec::new();
        for (point, pieces) in &self.beyond {
            let other = self.pieces[*point as usize];
            if other == NONE || pieces.clone().all(|piece| pairs.contains(&[piece, other as u32])) {
                continue;
            }
            // Pairs farther apart than neighbors are might not be seen by any window.
            grid.neighbors(*point, &mut found);
            let near = found.iter().map(|neighbor| self.pieces[neighbor.point as usize]).filter(|&piece| piece != NONE);
            pairs.extend(
                near.map(|piece| piece as u32)
                    .filter(|piece| pieces.contains(piece))
                    .map(|piece| [piece, other as u32]),
            );
        }
        pairs
    }

    /// One label for the pieces that hold together.
    pub(super) fn labels(&self, grid: &Grid<'_>, agree: impl Fn(&Plane, &Plane) -> bool) -> Labels {
        let mut sets = UnionFind::new(self.planes.len());
        for [a, b] in self.pairs(grid) {
            if agree(&self.planes[a as usize], &self.planes[b as usize]) {
                sets.union(a, b);
            }
        }
        let representatives = sets.into_representatives();
        let label = |&piece: &i64| if piece == NONE { NONE } else { i64::from(representatives[piece as usize]) };
        Labels::from_any(&self.pieces.iter().map(label).collect::<Vec<i64>>())
    }
}
