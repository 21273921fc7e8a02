//! Growing planes one after the other, each from its seed.
//!
//! A plane starts as the seed's own: its normal, through the center of gravity of its neighbors. It takes points in
//! breadth first, near ones first. It is *adjusted* to its points anew whenever they are a quarter more than those of the
//! last try (at first: than the seed's neighbors), and at the end. An adjustment counts only if its σ0 is low
//! enough, else the plane stays as it was.
//!
//! In the end a plane is the adjustment of exactly its points, and all of them are near it: if the last adjustment does
//! not count, the points that have come since the last that does are released; then those that are no longer near, after
//! which it is adjusted again, until none is released. Planes of very few points are given up altogether. Released points
//! are free for other planes, and may be seeds if they have not been.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::adjustment::{Adjusted, Sums};
use super::{Coplanarity, Plane};
use crate::lattice::Lattice;
use crate::neighborhood::{Grid, Neighbor};
use crate::window::Window;

/// A plane is adjusted anew when it has so many times the points of the last try.
const GROWTH_PER_ADJUSTMENT: f64 = 1.25;

/// Planes of fewer points are given up: three or four points lie near some plane wherever they are.
const FEWEST_POINTS: usize = 5;

/// No turn as a seed, or no longer.
const NO_TURN: u32 = u32::MAX;

/// What may become of a point.
#[derive(Clone, Copy, PartialEq)]
enum State {
    /// It takes no part.
    Outside,
    Free,
    Taken,
}

/// A plane and its points, in the order in which it took them in.
pub(super) struct Patch {
    pub(super) plane: Plane,
    pub(super) points: Vec<Member>,
}

/// A point of a patch.
pub(super) struct Member {
    pub(super) point: u32,
    /// The point whose neighbor it came in as; its own if it is the seed. May have been released.
    pub(super) parent: u32,
}

/// Grows planes among the points of a window.
pub(super) struct Growth<'a> {
    points: &'a [[f64; 3]],
    lattice: &'a Lattice,
    grid: &'a Grid<'a>,
    normals: [&'a [f64]; 3],
    /// For each point, the cosine of the greatest angle between its normal and that of its plane.
    cosines: Vec<f64>,
    limits: Coplanarity,
    states: Vec<State>,
    turns: Vec<u32>,
    /// For each point that is taken, the one whose neighbor it came in as.
    parents: Vec<u32>,
    found: Vec<Neighbor>,
}

/// A plane that is growing. Offsets are from its seed.
struct Growing {
    origin: [f64; 3],
    points: Vec<u32>,
    sums: Sums,
    plane: Adjusted,
    /// How many of the points the plane is adjusted to.
    adjusted: usize,
    next_adjustment: f64,
}

impl<'a> Growth<'a> {
    pub(super) fn new(
        window: &'a Window,
        grid: &'a Grid<'a>,
        normals: [&'a [f64]; 3],
        sigmas: &[f64],
        limits: Coplanarity,
    ) -> Self {
        let least = limits.min_angle_deg.to_radians().cos();
        // cos(2 atan σ) = (1 − σ²) / (1 + σ²).
        let cosine = |sigma: &f64| least.min((1.0 - sigma * sigma) / (1.0 + sigma * sigma));
        let points = window.points();
        Self {
            points,
            lattice: window.lattice(),
            grid,
            normals,
            cosines: sigmas.iter().map(cosine).collect(),
            limits,
            states: vec![State::Outside; points.len()],
            turns: vec![NO_TURN; points.len()],
            parents: vec![0; points.len()],
            found: Vec::new(),
        }
    }

    /// The planes among `points` alone, from those in `seeds`, first ones first.
    pub(super) fn grow_among(&mut self, points: &[u32], seeds: &[u32]) -> Vec<Patch> {
        self.set_states(points, State::Free);
        for (&seed, turn) in seeds.iter().zip(0..) {
            self.turns[seed as usize] = turn;
        }
        let mut turns: BinaryHeap<Reverse<u32>> = (0..seeds.len() as u32).map(Reverse).collect();
        let mut patches = Vec::new();
        while let Some(Reverse(turn)) = turns.pop() {
            let seed = seeds[turn as usize];
            if self.states[seed as usize] == State::Free && self.turns[seed as usize] != NO_TURN {
                self.turns[seed as usize] = NO_TURN;
                let (patch, released) = self.grow(seed);
                self.set_states(&released, State::Free);
                turns.extend(released.iter().map(|&i| self.turns[i as usize]).filter(|&t| t != NO_TURN).map(Reverse));
                patches.extend(patch);
            }
        }
        for &seed in seeds {
            self.turns[seed as usize] = NO_TURN;
        }
        self.set_states(points, State::Outside);
        patches
    }

    fn set_states(&mut self, points: &[u32], state: State) {
        for &point in points {
            self.states[point as usize] = state;
        }
    }

    /// Grows one plane as far as it goes; the patch, and the points that were in it for some time only.
    fn grow(&mut self, seed: u32) -> (Option<Patch>, Vec<u32>) {
        let mut growing = self.start(seed);
        if !self.fits(seed, &growing) {
            return (None, Vec::new());
        }
        self.take_in(seed, seed, &mut growing);
        let mut found = std::mem::take(&mut self.found);
        let mut next = 0;
        while let Some(&point) = growing.points.get(next) {
            self.grid.neighbors(point, &mut found);
            for neighbor in &found {
                if self.states[neighbor.point as usize] == State::Free && self.fits(neighbor.point, &growing) {
                    self.take_in(neighbor.point, point, &mut growing);
                }
            }
            next += 1;
        }
        self.found = found;
        self.finish(growing)
    }

    fn start(&mut self, seed: u32) -> Growing {
        let origin = self.points[seed as usize];
        let mut found = std::mem::take(&mut self.found);
        self.grid.neighbors(seed, &mut found);
        found.retain(|neighbor| self.states[neighbor.point as usize] != State::Outside);
        let center = Sums::of(found.iter().map(|neighbor| self.offset(&origin, neighbor.point))).center();
        let normal = self.normals.map(|component| component[seed as usize]);
        let next_adjustment = (found.len() as f64 * GROWTH_PER_ADJUSTMENT).max(3.0);
        self.found = found;
        let plane = Adjusted { center, normal, sigma0: 0.0 };
        Growing { origin, points: Vec::new(), sums: Sums::default(), plane, adjusted: 0, next_adjustment }
    }

    fn offset(&self, origin: &[f64; 3], point: u32) -> [f64; 3] {
        self.lattice.offset_between(origin, &self.points[point as usize])
    }

    fn fits(&self, point: u32, growing: &Growing) -> bool {
        let (i, plane) = (point as usize, &growing.plane);
        let cosine: f64 = self.normals.iter().zip(plane.normal).map(|(component, c)| component[i] * c).sum();
        // Walls have normals of either sign. NaN fits nowhere.
        cosine.abs() >= self.cosines[i] && self.is_near(point, &growing.origin, plane)
    }

    fn is_near(&self, point: u32, origin: &[f64; 3], plane: &Adjusted) -> bool {
        plane.distance(self.offset(origin, point)) < self.limits.max_distance
    }

    fn take_in(&mut self, point: u32, parent: u32, growing: &mut Growing) {
        self.parents[point as usize] = parent;
        self.states[point as usize] = State::Taken;
        growing.points.push(point);
        growing.sums.add(self.offset(&growing.origin, point));
        if growing.points.len() as f64 >= growing.next_adjustment {
            growing.adjust(self.limits.max_sigma);
        }
    }

    fn finish(&self, mut growing: Growing) -> (Option<Patch>, Vec<u32>) {
        if growing.adjusted < growing.points.len() {
            growing.adjust(self.limits.max_sigma);
        }
        let mut released = growing.points.split_off(growing.adjusted);
        let Growing { origin, points, mut plane, .. } = growing;
        let mut kept = points;
        let mut sums = Sums::of(kept.iter().map(|&point| self.offset(&origin, point)));
        loop {
            let (near, far): (Vec<u32>, Vec<u32>) = kept.iter().partition(|&&p| self.is_near(p, &origin, &plane));
            kept = near;
            if far.is_empty() {
                break;
            }
            released.extend(far);
            sums = Sums::of(kept.iter().map(|&point| self.offset(&origin, point)));
            match sums.adjust() {
                Some(adjusted) => plane = adjusted,
                None => released.append(&mut kept),
            }
        }
        if kept.len() < FEWEST_POINTS || plane.sigma0 >= self.limits.max_sigma {
            released.append(&mut kept);
            return (None, released);
        }
        let plane = plane.plane(self.lattice.real(&origin), &sums);
        let member = |point: u32| Member { point, parent: self.parents[point as usize] };
        (Some(Patch { plane, points: kept.into_iter().map(member).collect() }), released)
    }
}

impl Growing {
    /// Adjusts the plane to its points, if that fits well enough.
    fn adjust(&mut self, max_sigma: f64) {
        self.next_adjustment = self.points.len() as f64 * GROWTH_PER_ADJUSTMENT;
        if let Some(plane) = self.sums.adjust().filter(|plane| plane.sigma0 < max_sigma) {
            self.plane = plane;
            self.adjusted = self.points.len();
        }
    }
}
