//! The pass over a stored cloud that finds mean and standard deviation of its points' distances to their neighbors.
//!
//! 1. Window by window, with a halo in which almost all points have all their neighbors.
//! 2. The few that are left go through the cloud once more, from window to window, and gather their neighbors: a neighbor
//!    is among the nearest of what any window with it holds.
//!
//! So the result is exact and does not depend on the windows.

use std::collections::HashMap;
use std::sync::Arc;

use super::farthest::Farthest;
use super::moments::{Moments, Statistics};
use super::neighbor_distance::{NeighborDistances, grid_of, mean, nearest};
use super::{Preprocessed, Stage, StatisticalOutlierRemoval, apply_all, total_halo};
use crate::crew::Crew;
use crate::error::Result;
use crate::lattice::Lattice;
use crate::neighborhood::{Grid, Neighbor};
use crate::span::Spans;
use crate::survey::{LookUp, OwnIds, Survey};
use crate::window::{Halo, Window};

/// Measures a cloud for `removal`, which is to come after the stages `earlier`.
///
/// `open` gives the spans of the cloud, on `lattice`, each time from the start; `halo` is how far around a span neighbors are
/// looked for at first.
///
/// # Errors
/// If the cloud cannot be read, or a stage fails.
pub fn measure(
    removal: StatisticalOutlierRemoval,
    earlier: &[Arc<dyn Stage>],
    open: &mut dyn FnMut() -> Result<Spans>,
    lattice: Lattice,
    halo: f64,
    threads: usize,
    look_up: &mut dyn FnMut() -> LookUp,
) -> Result<Statistics> {
    let stages: Arc<[Arc<dyn Stage>]> = earlier.into();
    let needed = total_halo(earlier);
    let mut survey = |halo: f64, work: Work| -> Result<Survey<Found>> {
        let halo = if halo > 0.0 { Halo::Length(halo) } else { Halo::None };
        let stages = Arc::clone(&stages);
        let apply = move |window: &Window| {
            let Preprocessed { window: prepared, .. } = apply_all(&stages, window)?;
            Ok(work(&prepared, &OwnIds::of(window)))
        };
        let survey = Survey::new(open()?, lattice, vec![], halo, Crew::new(threads)?, Arc::new(apply))?;
        Ok(survey.with_look_up(look_up()))
    };
    let (mut distances, mut left) = (Distances::default(), Vec::new());
    for found in survey(needed + halo, Box::new(move |window, own| first_look(removal, window, own)))? {
        let found = found?;
        distances.merge(&found.distances);
        left.extend(found.left);
    }
    if !left.is_empty() {
        let searchers: Arc<[Left]> = left.into();
        let mut gathered = vec![Vec::new(); searchers.len()];
        let (shared, others) = (Arc::clone(&searchers), removal.others());
        for found in survey(needed, Box::new(move |window, own| second_look(&shared, others, window, own)))? {
            for (of, neighbors) in found?.neighbors {
                gather(&mut gathered[of], neighbors, others + 1);
            }
        }
        for (left, neighbors) in searchers.iter().zip(&gathered) {
            let lengths = neighbors.iter().filter(|n| n.id != left.id).map(|neighbor| neighbor.length);
            distances.add(mean(lengths.clone(), removal.itself()), lengths.fold(0.0, f64::max));
        }
    }
    let statistics = removal.statistics(&distances.means);
    let reach = distances.farthest.up_to(removal.threshold(&statistics));
    Ok(Statistics { reach: Some(reach), ..statistics })
}

/// What is kept of the distances of all points to their neighbors.
#[derive(Default)]
struct Distances {
    means: Moments,
    farthest: Farthest,
}

impl Distances {
    fn add(&mut self, mean: f64, last: f64) {
        self.means.add(mean);
        self.farthest.add(mean, last);
    }

    fn merge(&mut self, other: &Self) {
        self.means.merge(&other.means);
        self.farthest.merge(&other.farthest);
    }
}

type Work = Box<dyn Fn(&Window, &OwnIds) -> Found + Send + Sync>;

/// What a look at a window has found.
#[derive(Default)]
struct Found {
    distances: Distances,
    left: Vec<Left>,
    /// Neighbors of those left, by their number.
    neighbors: Vec<(usize, Vec<Near>)>,
}

/// A point whose neighbors are not all in the window it came with.
#[derive(Clone)]
struct Left {
    point: [f64; 3],
    id: i64,
    /// No neighbor is farther away.
    radius: f64,
}

/// A point, and how far it is from one that is left.
#[derive(Clone, Copy)]
struct Near {
    squared: f64,
    id: i64,
    length: f64,
}

fn first_look(removal: StatisticalOutlierRemoval, window: &Window, own: &OwnIds) -> Found {
    let mut found = Found::default();
    let grid = grid_of(window, removal.others());
    let mut distances = NeighborDistances::new(window, &grid, removal.others(), removal.itself());
    for point in distances.order() {
        let id = window.point_ids()[point as usize];
        if !own.contains(id) {
            continue;
        }
        let d = distances.of(point);
        if d.low == d.high {
            found.distances.add(d.high, distances.farthest());
        } else {
            found.left.push(Left { point: window.points()[point as usize], id, radius: distances.last_radius() });
        }
    }
    found
}

fn second_look(left: &[Left], others: usize, window: &Window, own: &OwnIds) -> Found {
    let is_own = |i: &usize| own.contains(window.point_ids()[*i]);
    let own_points: Vec<usize> = (0..window.points().len()).filter(is_own).collect();
    let bounds = Bounds::of(own_points.iter().map(|&i| window.lattice().real(&window.points()[i])));
    let near: Vec<usize> = (0..left.len())
        .filter(|&i| bounds.distance(&window.lattice().real(&left[i].point)) <= left[i].radius * (1.0 + 1e-9))
        .collect();
    if near.is_empty() || own_points.is_empty() {
        return Found::default();
    }
    // Those left are looked for among themselves too: they are points of the cloud.
    let foreign = near.iter().filter(|&&i| !own.contains(left[i].id));
    let mut points: Vec<[f64; 3]> = own_points.iter().map(|&i| window.points()[i]).collect();
    let mut ids: Vec<i64> = own_points.iter().map(|&i| window.point_ids()[i]).collect();
    for &i in foreign {
        points.push(left[i].point);
        ids.push(left[i].id);
    }
    let place_of: HashMap<i64, u32> = ids.iter().copied().zip(0..).collect();
    let grid = Grid::new(&points, &ids, window.lattice(), nearest(others.min(points.len())));
    let mut found = Vec::new();
    let neighbors = near.into_iter().filter_map(|i| {
        grid.neighbors(*place_of.get(&left[i].id)?, &mut found);
        let near =
            |n: &Neighbor| Near { squared: n.squared, id: ids[n.point as usize], length: grid.length(n.squared) };
        Some((i, found.iter().map(near).collect()))
    });
    Found { neighbors: neighbors.collect(), ..Found::default() }
}

/// Keeps the nearest of two lists, each point once.
fn gather(nearest: &mut Vec<Near>, more: Vec<Near>, most: usize) {
    nearest.extend(more);
    nearest.sort_by(|a, b| a.squared.total_cmp(&b.squared).then(a.id.cmp(&b.id)));
    nearest.dedup_by_key(|near| near.id);
    nearest.truncate(most);
}

/// A box around points.
struct Bounds {
    low: [f64; 3],
    high: [f64; 3],
}

impl Bounds {
    fn of(points: impl Iterator<Item = [f64; 3]>) -> Self {
        let mut bounds = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };
        for point in points {
            for ((low, high), along) in bounds.low.iter_mut().zip(&mut bounds.high).zip(point) {
                (*low, *high) = (low.min(along), high.max(along));
            }
        }
        bounds
    }

    /// How far a point lies outside.
    fn distance(&self, point: &[f64; 3]) -> f64 {
        let [x, y, z] =
            std::array::from_fn(|axis| (self.low[axis] - point[axis]).max(point[axis] - self.high[axis]).max(0.0));
        (x * x + y * y + z * z).sqrt()
    }
}
