//! Every neighbor search against measuring all pairs in whole numbers, and what has to hold whatever the cloud.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use streamseg::lattice::{Lattice, Metric, Within};
use streamseg::neighborhood::{Grid, Neighbor, Search};
use streamseg::union_find::UnionFind;

/// A cloud in whole numbers, and what a step is worth on each axis.
#[derive(Debug, Clone)]
struct Cloud {
    points: Vec<[i64; 3]>,
    point_ids: Vec<i64>,
    /// Steps of the finest axis per step of each.
    weights: [i64; 3],
    /// Where it lies, and whether it is known to be on a lattice.
    place: Place,
}

#[derive(Debug, Clone, Copy)]
enum Place {
    /// Steps of 1 cm (of the finest axis) from an offset.
    OnLattice,
    /// Real coordinates of such a lattice, with all the rounding they have far from zero.
    Real { offset: f64 },
}

const STEP: f64 = 0.01;

impl Cloud {
    fn lattice(&self) -> Lattice {
        match self.place {
            Place::OnLattice => Lattice::new(self.weights.map(|w| w as f64 * STEP), [5e5, 5.4e6, 0.0]).unwrap(),
            Place::Real { .. } => Lattice::REAL,
        }
    }

    fn coordinates(&self) -> Vec<[f64; 3]> {
        let real = |offset: f64, p: &[i64; 3]| std::array::from_fn(|k| (p[k] * self.weights[k]) as f64 * STEP + offset);
        match self.place {
            Place::OnLattice => self.points.iter().map(|p| p.map(|c| c as f64)).collect(),
            Place::Real { offset } => self.points.iter().map(|p| real(offset, p)).collect(),
        }
    }

    fn squared(&self, a: usize, b: usize, axes: usize) -> i64 {
        (0..axes).map(|k| ((self.points[a][k] - self.points[b][k]) * self.weights[k]).pow(2)).sum()
    }

    fn rise(&self, a: usize, b: usize) -> i64 {
        (self.points[b][2] - self.points[a][2]) * self.weights[2]
    }
}

/// A search in whole steps of the finest axis; radii are squared.
#[derive(Debug, Clone, Copy)]
enum Sought {
    Disc(i64),
    Cylinder(i64, i64, i64),
    Ball(i64),
    Nearest(usize, bool, Option<i64>),
}

impl Sought {
    fn search(self) -> Search {
        let radius = |squared: i64| (squared as f64).sqrt() * STEP;
        match self {
            Sought::Disc(squared) => Search::disc(radius(squared)).unwrap(),
            Sought::Cylinder(squared, low, high) => {
                Search::cylinder(radius(squared), low as f64 * STEP, high as f64 * STEP).unwrap()
            }
            Sought::Ball(squared) => Search::ball(radius(squared)).unwrap(),
            Sought::Nearest(k, flat, within) => {
                Search::Nearest { k, flat, within: within.map_or(f64::INFINITY, radius) }
            }
        }
    }

    /// The neighbors by measuring the distance to all points.
    fn neighbors(self, cloud: &Cloud, point: usize) -> Vec<usize> {
        let axes = match self {
            Sought::Disc(_) | Sought::Cylinder(..) | Sought::Nearest(_, true, _) => 2,
            Sought::Ball(_) | Sought::Nearest(_, false, _) => 3,
        };
        let squared = |other| cloud.squared(point, other, axes);
        let near = |&other: &usize| match self {
            Sought::Disc(limit) | Sought::Ball(limit) => squared(other) <= limit,
            Sought::Cylinder(limit, low, high) => {
                squared(other) <= limit && (low..=high).contains(&cloud.rise(point, other))
            }
            Sought::Nearest(_, _, within) => within.is_none_or(|limit| squared(other) <= limit),
        };
        let mut found: Vec<usize> = (0..cloud.points.len()).filter(near).collect();
        found.sort_by_key(|&other| (other != point, squared(other), cloud.point_ids[other]));
        if let Sought::Nearest(k, ..) = self {
            found.truncate(k);
        }
        found
    }
}

fn coordinate(spread: i64) -> impl Strategy<Value = i64> {
    -spread..=spread
}

/// Points in a box, of which many coincide or lie on one circle if it is small.
fn in_a_box() -> impl Strategy<Value = Vec<[i64; 3]>> {
    (prop::sample::select(vec![0i64, 1, 3, 9, 60]), prop::sample::select(vec![0i64, 2, 30])).prop_flat_map(|(xy, z)| {
        prop::collection::vec((coordinate(xy), coordinate(xy), coordinate(z)), 0..150)
            .prop_map(|points| points.into_iter().map(|(x, y, z)| [x, y, z]).collect())
    })
}

/// Points on and about a line.
fn on_a_line() -> impl Strategy<Value = Vec<[i64; 3]>> {
    let step = (coordinate(3), coordinate(3), coordinate(1));
    (step, prop::collection::vec((coordinate(200), coordinate(1)), 1..150))
        .prop_map(|((x, y, z), along)| along.into_iter().map(|(t, aside)| [t * x + aside, t * y, t * z]).collect())
}

/// Dense and sparse places side by side, and a few points far away.
fn uneven() -> impl Strategy<Value = Vec<[i64; 3]>> {
    let dense = prop::collection::vec((coordinate(2), coordinate(2), coordinate(1)), 0..100);
    let sparse = prop::collection::vec((coordinate(100), coordinate(100), coordinate(20)), 0..50);
    // The sum of their squares is exact up to here.
    let far = prop::collection::vec((coordinate(20_000_000), coordinate(20_000_000), coordinate(1_000_000)), 0..4);
    (dense, sparse, far).prop_map(|(dense, sparse, far)| {
        dense.into_iter().chain(sparse).chain(far).map(|(x, y, z)| [x, y, z]).collect()
    })
}

fn weights() -> impl Strategy<Value = [i64; 3]> {
    prop::sample::select(vec![[1, 1, 1], [10, 10, 1], [1, 5, 10], [1, 1, 7]])
}

fn cloud(places: Vec<Place>) -> impl Strategy<Value = Cloud> {
    let points = prop_oneof![3 => in_a_box(), 1 => on_a_line(), 2 => uneven()];
    (points, weights(), prop::sample::select(places)).prop_flat_map(|(points, weights, place)| {
        let ids: Vec<i64> = (0..points.len() as i64).map(|i| 3 * i + 7).collect();
        Just(ids).prop_shuffle().prop_map(move |point_ids| Cloud { points: points.clone(), point_ids, weights, place })
    })
}

fn any_place() -> Vec<Place> {
    vec![Place::OnLattice, Place::OnLattice, Place::Real { offset: 0.0 }, Place::Real { offset: 5_400_000.0 }]
}

fn radius() -> impl Strategy<Value = i64> {
    prop_oneof![1i64..30, (1i64..40).prop_map(|r| r * r), 1i64..20_000]
}

fn by_radius() -> impl Strategy<Value = Sought> {
    prop_oneof![
        radius().prop_map(Sought::Disc),
        radius().prop_map(Sought::Ball),
        (radius(), 0i64..30, 0i64..30).prop_map(|(radius, low, high)| Sought::Cylinder(radius, -low, high)),
    ]
}

fn by_number() -> impl Strategy<Value = Sought> {
    (prop_oneof![1usize..40, Just(500)], any::<bool>(), prop::option::of(radius()))
        .prop_map(|(k, flat, within)| Sought::Nearest(k, flat, within))
}

fn symmetric() -> impl Strategy<Value = Sought> {
    prop_oneof![
        radius().prop_map(Sought::Disc),
        radius().prop_map(Sought::Ball),
        (radius(), 0i64..30).prop_map(|(radius, high)| Sought::Cylinder(radius, -high, high)),
    ]
}

fn numbers(found: &[Neighbor]) -> Vec<usize> {
    found.iter().map(|neighbor| neighbor.point as usize).collect()
}

proptest! {
    #[test]
    fn neighbors_are_those_of_all_pairs_in_the_same_order(
        cloud in cloud(vec![Place::OnLattice]), sought in prop_oneof![by_radius(), by_number()]
    ) {
        let points = cloud.coordinates();
        let grid = Grid::new(&points, &cloud.point_ids, &cloud.lattice(), sought.search());
        let (mut finder, mut found) = (grid.finder(), Vec::new());
        for point in 0..points.len() {
            grid.neighbors(point as u32, &mut found);
            prop_assert_eq!(numbers(&found), sought.neighbors(&cloud, point));
            let alone = found.clone();
            finder.neighbors(point as u32, &mut found);
            prop_assert_eq!(&found, &alone);
            for neighbor in &found {
                let axes = if matches!(sought, Sought::Ball(_) | Sought::Nearest(_, false, _)) { 3 } else { 2 };
                let squared = cloud.squared(point, neighbor.point as usize, axes) as f64;
                prop_assert!((grid.length(neighbor.squared) - squared.sqrt() * STEP).abs() <= 1e-12 * squared.sqrt());
            }
        }
    }

    /// Rounding may put equal distances into any order, but not a neighbor outside.
    #[test]
    fn real_coordinates_have_the_neighbors_of_the_lattice_they_come_from(
        cloud in cloud(any_place()), sought in by_radius()
    ) {
        let points = cloud.coordinates();
        let grid = Grid::new(&points, &cloud.point_ids, &cloud.lattice(), sought.search());
        for point in 0..points.len() {
            let mut found = Vec::new();
            grid.for_each_neighbor(point as u32, |neighbor| found.push(neighbor.point as usize));
            found.sort_unstable();
            let mut expected = sought.neighbors(&cloud, point);
            expected.sort_unstable();
            for limit in 1..=expected.len() + 1 {
                prop_assert_eq!(grid.has_neighbors(point as u32, limit), limit <= expected.len());
            }
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn every_pair_of_neighbors_is_visited_once_and_joined(cloud in cloud(any_place()), sought in symmetric()) {
        let points = cloud.coordinates();
        let grid = Grid::new(&points, &cloud.point_ids, &cloud.lattice(), sought.search());
        let mut pairs = Vec::new();
        grid.for_each_pair(|a, b| pairs.push((a.min(b) as usize, a.max(b) as usize)));
        pairs.sort_unstable();
        let all = |a: usize| sought.neighbors(&cloud, a).into_iter().filter(move |&b| a < b).map(move |b| (a, b));
        let mut expected: Vec<(usize, usize)> = (0..points.len()).flat_map(all).collect();
        expected.sort_unstable();
        prop_assert_eq!(&pairs, &expected);

        let (mut joined, mut of_pairs) = (UnionFind::new(points.len()), UnionFind::new(points.len()));
        grid.join_neighbors(&mut joined);
        for (a, b) in expected {
            of_pairs.union(a as u32, b as u32);
        }
        prop_assert_eq!(joined.into_representatives(), of_pairs.into_representatives());
    }

    /// Bit for bit, and even where coordinates are on no lattice.
    #[test]
    fn neither_the_order_of_the_points_nor_what_else_there_is_matters(
        cloud in cloud(any_place()), sought in prop_oneof![by_radius(), by_number()], seed in any::<u64>(), half in any::<bool>()
    ) {
        let points = cloud.coordinates();
        let by_id = |points: &[[f64; 3]], ids: &[i64]| {
            let grid = Grid::new(points, ids, &cloud.lattice(), sought.search());
            let (mut finder, mut found) = (grid.finder(), Vec::new());
            let mut of = |point: u32| {
                finder.neighbors(point, &mut found);
                let alone = found.clone();
                grid.neighbors(point, &mut found);
                assert_eq!(found, alone);
                let neighbors = found.iter().map(|n| (ids[n.point as usize], n.squared.to_bits()));
                (ids[point as usize], neighbors.collect::<Vec<_>>())
            };
            grid.order().iter().map(|&point| of(point)).collect::<std::collections::BTreeMap<_, _>>()
        };
        let expected = by_id(&points, &cloud.point_ids);
        let mut shuffled: Vec<usize> = (0..points.len()).collect();
        shuffled.sort_by_key(|&i| (i as u64 ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        // Half of the cloud: those whose neighbors are all in it have the same.
        let x_of = |i: usize| points[i][0];
        let middle = points.iter().map(|p| p[0]).sum::<f64>() / points.len() as f64;
        shuffled.retain(|&i| !half || x_of(i) <= middle);
        let some: Vec<[f64; 3]> = shuffled.iter().map(|&i| points[i]).collect();
        let ids: Vec<i64> = shuffled.iter().map(|&i| cloud.point_ids[i]).collect();
        for (id, neighbors) in by_id(&some, &ids) {
            let all = &expected[&id];
            if all.iter().all(|(id, _)| ids.contains(id)) {
                prop_assert_eq!(all, &neighbors);
            }
        }
    }

    /// The rule of the whole tree.
    #[test]
    fn a_pair_is_within_the_radius_exactly_when_within_says_so(
        places in prop::collection::vec((0i64..60, 0i64..60, 0i64..9), 0..60), radius in radius(),
        offset in prop::sample::select(vec![0.0, 1.0 / 3.0, 5_400_000.1, 1e9]), scale in prop::sample::select(vec![1.0, 0.3, 1.0 / 3.0])
    ) {
        let points: Vec<[f64; 3]> =
            places.iter().map(|&(x, y, z)| [x as f64 * 0.01 + offset, y as f64 * 0.013 + offset, z as f64 * 0.07]).collect();
        let ids: Vec<i64> = (0..points.len() as i64).collect();
        let steps: Vec<[f64; 3]> = places.iter().map(|&(x, y, z)| [x as f64, y as f64, z as f64]).collect();
        let odd = Lattice::new([0.01, 0.01 * scale, 0.007], [offset; 3]).unwrap();
        let radius = (radius as f64).sqrt() * 0.01;
        for (points, lattice) in [(&points, Lattice::REAL), (&steps, odd)] {
            for (search, metric) in [(Search::Ball { radius }, Metric::Xyz), (Search::Disc { radius }, Metric::Xy)] {
                let within = Within::new(radius, metric, &lattice);
                let grid = Grid::new(points, &ids, &lattice, search);
                for a in 0..points.len() {
                    let mut found = Vec::new();
                    grid.for_each_neighbor(a as u32, |neighbor| found.push(neighbor.point as usize));
                    found.sort_unstable();
                    let expected: Vec<usize> = (0..points.len()).filter(|&b| within.pair(&points[a], &points[b])).collect();
                    prop_assert_eq!(found, expected);
                }
            }
        }
    }
}

fn ids(points: &[[f64; 3]]) -> Vec<i64> {
    (0..points.len() as i64).collect()
}

#[test]
fn thousands_of_points_at_one_place_are_searched_in_no_time() {
    let points = vec![[7.25; 3]; 100_000];
    let ids: Vec<i64> = (0..100_000).rev().collect();
    let grid = Grid::new(&points, &ids, &Lattice::REAL, Search::nearest(30, None).unwrap());
    let (mut finder, mut found) = (grid.finder(), Vec::new());
    for point in 0..100_000u32 {
        finder.neighbors(point, &mut found);
        assert_eq!(found[0].point, point);
        let smallest = (0..100_000).rev().filter(|&other| other != point).take(29);
        assert!(found[1..].iter().map(|neighbor| neighbor.point).eq(smallest));
    }
    let grid = Grid::new(&points, &ids, &Lattice::REAL, Search::ball(1e-9).unwrap());
    let mut sets = UnionFind::new(points.len());
    grid.join_neighbors(&mut sets);
    assert!(sets.into_representatives().iter().all(|&of| of == 0));
    assert!((0..100_000).all(|point| grid.has_neighbors(point, 1000)));
    assert!(!grid.has_neighbors(0, 100_001));
}

#[test]
fn corridors_and_stray_points_take_no_more_than_others() {
    // A diagonal of points far apart, another of near ones, and points as far away as coordinates go.
    let mut points: Vec<[f64; 3]> =
        (0..50_000).map(|i| [f64::from(i) * 1e5, f64::from(i) * -1e5, f64::from(i)]).collect();
    points.extend((0..50_000).map(|i| [f64::from(i) * 0.01, f64::from(i) * 0.01, 1e5]));
    points.extend([[1e60; 3], [-1e60; 3], [1e-300; 3], [1e30, 0.0, 0.0]]);
    let ids = ids(&points);
    for search in [Search::ball(0.02).unwrap(), Search::disc(0.02).unwrap(), Search::nearest(10, None).unwrap()] {
        let grid = Grid::new(&points, &ids, &Lattice::REAL, search);
        let (mut finder, mut found) = (grid.finder(), Vec::new());
        for point in 0..points.len() as u32 {
            finder.neighbors(point, &mut found);
            assert_eq!(found[0].point, point);
            assert!(found.len() <= 10);
        }
    }
    let mut sets = UnionFind::new(points.len());
    Grid::new(&points, &ids, &Lattice::REAL, Search::ball(0.02).unwrap()).join_neighbors(&mut sets);
    let representatives = sets.into_representatives();
    assert!(representatives[50_000..100_000].iter().all(|&of| of == 50_000));
    assert!((0..50_000).all(|i| representatives[i] == i as u32));
}

#[test]
fn no_point_and_one_point() {
    for search in [Search::ball(1.0).unwrap(), Search::nearest(3, None).unwrap()] {
        let grid = Grid::new(&[], &[], &Lattice::REAL, search);
        assert!(grid.order().is_empty());
        grid.join_neighbors(&mut UnionFind::new(0));
        let grid = Grid::new(&[[1.0, 2.0, 3.0]], &[5], &Lattice::REAL, search);
        let mut found = vec![Neighbor { point: 9, squared: 9.0 }];
        grid.neighbors(0, &mut found);
        assert_eq!(found, [Neighbor { point: 0, squared: 0.0 }]);
    }
}
