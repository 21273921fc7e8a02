//! The canonical Delaunay graph depends on the places alone: it is what exact arithmetic says, whatever their order,
//! wherever they lie and whichever way they are turned. On lattices, where most of what is special comes together.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use clouds::{Place, cases};
use oracle::circles::{Pair, Spot, canonical_graph};
use oracle::delaunay::{Adjacency, adjacency};
use oracle::partition::{canonical, components};
use oracle::radius::squared_length;
use proptest::prelude::*;
use streaming::{Run, static_labels, stream};
use streamseg::lattice::{Lattice, Metric};
use streamseg::neighborhood::Delaunay;
use streamseg::segmentor::Proximity;
use streamseg::span::{Direction, Source, SpanBy};
use streamseg::window::WindowSize;

/// Clouds of up to 40 points in any order, of several parts around few centers, so that they meet in special ways.
fn cloud() -> impl Strategy<Value = Vec<Place>> {
    let part = prop_oneof![
        3 => quantised(), 2 => grid(), 3 => circle(), 2 => line(), 1 => almost_circle(), 1 => stack(), 1 => wide(),
    ];
    let center = prop_oneof![3 => Just([0, 0]), 1 => (-6i64..7, -6i64..7).prop_map(Spot::from)];
    let parts = prop::collection::vec((part, center), 0..5);
    let moved = |(part, [x, y]): (Vec<Place>, Spot)| -> Vec<Place> {
        part.into_iter().map(|place| [place[0] + x, place[1] + y, place[2]]).collect()
    };
    let joined = parts.prop_map(move |parts| parts.into_iter().flat_map(moved).collect::<Vec<Place>>());
    joined.prop_shuffle().prop_map(|mut cloud| {
        cloud.truncate(40);
        cloud
    })
}

fn with_heights(spots: impl Strategy<Value = Vec<Spot>>) -> impl Strategy<Value = Vec<Place>> {
    // On two levels far apart, places are joined across others: each pair of the graph matters.
    let heights = prop_oneof![
        prop::collection::vec(-3i64..4, 16),
        prop::collection::vec(0i64..2, 16)
            .prop_map(|levels| levels.into_iter().map(|level| 9000 * level).collect::<Vec<i64>>())
    ];
    (spots, heights).prop_map(|(spots, heights)| {
        spots.into_iter().zip(heights.into_iter().cycle()).map(|([x, y], z)| [x, y, z]).collect()
    })
}

/// Points on so small a lattice that most of them coincide or share circles.
fn quantised() -> impl Strategy<Value = Vec<Place>> {
    let side = prop::sample::select(vec![2i64, 3, 5, 9, 30]);
    side.prop_flat_map(|side| with_heights(prop::collection::vec((0..side, 0..side).prop_map(Spot::from), 1..16)))
}

/// A part of a grid of squares, upright or turned; one edge of the squares is (a, b).
fn grid() -> impl Strategy<Value = Vec<Place>> {
    let step =
        prop::sample::select(vec![[1i64, 0], [1, 1], [2, 1], [3, 4], [5, 12], [300, 400], [997, 1], [123_457, 98_765]]);
    let knots = prop::collection::btree_set((0i64..4, 0i64..4), 3..17);
    with_heights(
        (step, knots)
            .prop_map(|([a, b], knots)| knots.into_iter().map(|(i, j)| [i * a - j * b, i * b + j * a]).collect()),
    )
}

/// Some lattice points of the circle x² + y² = 25 k, and perhaps its center.
fn circle() -> impl Strategy<Value = Vec<Place>> {
    with_heights(rim().prop_flat_map(|rim| {
        let most = rim.len().min(14);
        (prop::sample::subsequence(rim, 3..=most), any::<bool>(), prop::sample::select(vec![1i64, 1, 60, 1_000_000]))
            .prop_map(|(rim, has_center, size)| {
                let center = has_center.then_some([0, 0]);
                rim.into_iter().chain(center).map(|[x, y]| [x * size, y * size]).collect()
            })
    }))
}

/// All lattice points of a circle around the origin.
fn rim() -> impl Strategy<Value = Vec<Spot>> {
    let squared = prop::sample::select(vec![1i64, 2, 4, 5, 10, 13, 17, 25, 26, 29, 34, 37, 41, 50, 65, 85, 169, 221]);
    squared.prop_map(|k| {
        let squared = 25 * k;
        let least = -squared.isqrt();
        let spots = (least..=-least).flat_map(|x| (least..=-least).map(move |y| [x, y]));
        spots.filter(|[x, y]| x * x + y * y == squared).collect()
    })
}

/// A circle whose points have been moved by one step or none: near enough to one circle to deceive rounded arithmetic.
fn almost_circle() -> impl Strategy<Value = Vec<Place>> {
    let moves = prop::collection::vec((-1i64..2, -1i64..2), 12);
    let size = prop::sample::select(vec![100i64, 1_000_000]);
    with_heights((rim(), moves, size).prop_map(|(rim, moves, size)| {
        rim.into_iter().zip(moves).map(|([x, y], (dx, dy))| [size * x + dx, size * y + dy]).collect()
    }))
}

/// Points at even and uneven steps along a line.
fn line() -> impl Strategy<Value = Vec<Place>> {
    let step = prop_oneof![(-3i64..4, -3i64..4), Just((1001, 7))];
    with_heights(
        (step, prop::collection::vec(-8i64..9, 1..12))
            .prop_map(|((dx, dy), steps)| steps.into_iter().map(|k| [k * dx, k * dy]).collect()),
    )
}

/// Many heights at few places.
fn stack() -> impl Strategy<Value = Vec<Place>> {
    prop::collection::vec((0i64..2, 0i64..2, -9i64..10).prop_map(Place::from), 1..12)
}

/// Points in general position, thousands of steps apart.
fn wide() -> impl Strategy<Value = Vec<Place>> {
    with_heights(prop::collection::vec((-5000i64..5000, -5000i64..5000).prop_map(Spot::from), 1..12))
}

/// The same places turned, mirrored and moved. All of it is exact, as far as whole numbers go.
#[derive(Debug, Clone, Copy)]
struct Motion {
    quarter_turns: u32,
    is_mirrored: bool,
    by: Spot,
}

impl Motion {
    fn spot(self, [x, y]: Spot) -> Spot {
        let [x, y] = if self.is_mirrored { [y, x] } else { [x, y] };
        let [x, y] = (0..self.quarter_turns).fold([x, y], |[x, y], _| [-y, x]);
        [x + self.by[0], y + self.by[1]]
    }

    fn pair(self, [p, q]: Pair) -> Pair {
        let [p, q] = [self.spot(p), self.spot(q)];
        [p.min(q), p.max(q)]
    }
}

/// Some of them to where surveys lie, in centimeters.
fn motion() -> impl Strategy<Value = Motion> {
    let by = prop_oneof![Just([0, 0]), Just([50_000_000, 540_000_000]), (-99i64..99, -99i64..99).prop_map(Spot::from)];
    (0u32..4, any::<bool>(), by).prop_map(|(quarter_turns, is_mirrored, by)| Motion { quarter_turns, is_mirrored, by })
}

fn spots(cloud: &[Place]) -> BTreeSet<Spot> {
    cloud.iter().map(|&[x, y, _]| [x, y]).collect()
}

/// The pairs that the library calls neighbors, settled or not.
///
/// # Panics
/// If its stacks are not the places of the cloud, with their points in order of height.
fn graph(cloud: &[Place]) -> BTreeSet<Pair> {
    let horizontal: Vec<[f64; 2]> = cloud.iter().map(|place| [place[0] as f64, place[1] as f64]).collect();
    let delaunay = Delaunay::new(&horizontal, |point| cloud[point as usize][2] as f64);
    let place = |at: usize| cloud[delaunay.order()[at] as usize];
    let mut heights: BTreeMap<Spot, Vec<i64>> = BTreeMap::new();
    for &[x, y, z] in cloud {
        heights.entry([x, y]).or_default().push(z);
    }
    for heights in heights.values_mut() {
        heights.sort_unstable();
    }
    for stack in delaunay.stacks() {
        let [x, y, _] = place(stack.start);
        assert!(stack.clone().all(|at| place(at)[..2] == [x, y]), "a stack of several places");
        assert_eq!(heights.remove(&[x, y]), Some(stack.map(|at| place(at)[2]).collect()));
    }
    assert!(heights.is_empty(), "no stack at {heights:?}");

    let pair = |a: usize, b: usize| {
        let [p, q] = [a, b].map(|at| [place(at)[0], place(at)[1]]);
        [p.min(q), p.max(q)]
    };
    let mut pairs = BTreeSet::new();
    delaunay.for_each_edge(|a, b, _| assert!(pairs.insert(pair(a.start, b.start)), "an edge comes twice"));
    delaunay.for_each_cocircular_pair(
        |_| false,
        |a, b, _| {
            pairs.insert(pair(a.start, b.start));
        },
    );
    pairs
}

/// The segments that the pairs of the graph make of a cloud: points within the distance at one place or at neighboring ones.
fn segments(cloud: &[Place], graph: &BTreeSet<Pair>, squared: i64) -> Vec<i64> {
    let spot = |point: usize| [cloud[point][0], cloud[point][1]];
    let are_neighbors = |p: Spot, q: Spot| p == q || graph.contains(&[p.min(q), p.max(q)]);
    let pairs = (0..cloud.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    let joined =
        pairs.filter(|&(a, b)| squared_length(cloud[a], cloud[b], 3) <= squared && are_neighbors(spot(a), spot(b)));
    components(cloud.len(), joined)
}

fn positions(cloud: &[Place]) -> Vec<[f64; 3]> {
    cloud.iter().map(|place| place.map(|k| k as f64)).collect()
}

fn lattice() -> Lattice {
    Lattice::new([1.0; 3], [0.0; 3]).unwrap()
}

fn proximity(squared: i64) -> Proximity {
    Proximity::new((squared as f64).sqrt(), Metric::Xyz).unwrap()
}

fn segmented(cloud: &[Place], squared: i64) -> Vec<i32> {
    canonical(&static_labels(&positions(cloud), lattice(), &proximity(squared)))
}

fn squared_distance() -> impl Strategy<Value = i64> {
    prop::sample::select(vec![1i64, 2, 4, 5, 9, 10, 16, 25, 50, 100, 169, 2500, 250_000, 22_500, 1_000_000, 25_000_000])
}

proptest! {
    #![proptest_config(cases(256))]

    /// The graph holds the pairs with an empty circle and no other.
    #[test]
    fn the_graph_is_all_pairs_with_an_empty_circle(cloud in cloud()) {
        prop_assert_eq!(graph(&cloud), canonical_graph(&spots(&cloud)));
    }

    /// What is joined in space are the components of its pairs, although not all of them are looked at.
    #[test]
    fn segments_are_components_of_the_graph(cloud in cloud(), squared in squared_distance()) {
        let expected = segments(&cloud, &canonical_graph(&spots(&cloud)), squared);
        prop_assert_eq!(segmented(&cloud, squared), canonical(&expected));
    }

    /// So they are if windows slide over the cloud, in whatever direction, as soon as every pair in reach shares one.
    #[test]
    fn streamed_segments_are_components_of_the_graph(
        cloud in cloud(), squared in squared_distance(), azimuth in -360.0f64..360.0, is_upright in any::<bool>(),
        size in (2usize..5).prop_flat_map(|spans| (Just(spans), 1..spans)), spare in 0.0f64..1.0, threads in 1usize..3,
    ) {
        let reach = (squared as f64).sqrt();
        let widest = reach.max(cloud.iter().flatten().map(|k| k.abs()).max().unwrap_or(0) as f64);
        let by = SpanBy::Width {
            width: reach / size.1 as f64 * (1.0 + 2e-6) + (widest - reach) * spare.powi(8),
            direction: if is_upright { Direction::Y } else { Direction::Azimuth(azimuth) },
        };
        let size = WindowSize::new(size.0, size.1).unwrap();
        let run = Run { by, size, source: Source::Stored, chunks: vec![7, 1], threads };
        let streamed = stream(&positions(&cloud), lattice(), Arc::new(proximity(squared)), &run);
        let expected = segments(&cloud, &canonical_graph(&spots(&cloud)), squared);
        prop_assert_eq!(canonical(&streamed.settled), canonical(&expected));
        prop_assert!(streamed.certificate.is_complete(), "{:?}", streamed.certificate);
    }

    /// Neither the order of the points nor where the cloud lies and which way it is turned makes a difference. Larger
    /// clouds, since no oracle has to follow.
    #[test]
    fn the_graph_depends_on_the_places_alone(
        (cloud, shuffled) in prop::collection::vec(cloud(), 1..6).prop_map(|clouds| clouds.concat())
            .prop_flat_map(|cloud| (Just(cloud.clone()), Just(cloud).prop_shuffle())),
        motion in motion(), squared in squared_distance(),
    ) {
        let moved: Vec<Place> = shuffled.iter().map(|&[x, y, z]| {
            let [x, y] = motion.spot([x, y]);
            [x, y, z]
        }).collect();
        let expected: BTreeSet<Pair> = graph(&cloud).into_iter().map(|pair| motion.pair(pair)).collect();
        prop_assert_eq!(graph(&moved), expected);
        let partition = |cloud: &[Place], name: &dyn Fn(Place) -> Place| -> BTreeSet<BTreeSet<Place>> {
            let mut parts: BTreeMap<i32, BTreeSet<Place>> = BTreeMap::new();
            for (&label, &place) in segmented(cloud, squared).iter().zip(cloud) {
                parts.entry(label).or_default().insert(name(place));
            }
            parts.into_values().collect()
        };
        let name = |[x, y, z]: Place| {
            let [x, y] = motion.spot([x, y]);
            [x, y, z]
        };
        prop_assert_eq!(partition(&moved, &|place| place), partition(&cloud, &name));
    }

    /// Two oracles that have nothing in common: circles of three places, and for a pair all circles through its ends.
    #[test]
    fn the_oracles_agree(cloud in cloud()) {
        let places = spots(&cloud);
        let points: Vec<Place> = places.iter().map(|&[x, y]| [x, y, 0]).collect();
        let pairs = (0..points.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        let neighbors = pairs.filter(|&(a, b)| adjacency(&points, a, b) != Adjacency::None);
        let by_pair: BTreeSet<Pair> = neighbors.map(|(a, b)| [a, b].map(|k| [points[k][0], points[k][1]])).collect();
        prop_assert_eq!(by_pair, canonical_graph(&places));
    }
}

#[test]
fn places_on_one_empty_circle_are_all_neighbors() {
    let rim: Vec<Place> = [[5, 0], [4, 3], [3, 4], [0, 5]]
        .into_iter()
        .flat_map(|[x, y]| [[x, y, 0], [-y, x, 0], [-x, -y, 0], [y, -x, 0]])
        .collect();
    // The corners on the axes come once from each of their neighbors.
    assert_eq!((rim.len(), spots(&rim).len()), (16, 12));
    assert_eq!(graph(&rim).len(), 12 * 11 / 2);
    let with_center = [rim, vec![[0, 0, 7]]].concat();
    assert_eq!(graph(&with_center).len(), 12 + 12, "neighbors along the rim, and spokes");
}

#[test]
fn squares_of_a_grid_have_both_diagonals() {
    let grid: Vec<Place> = (0..7).flat_map(|x| (0..5).map(move |y| [x, y, 0])).collect();
    assert_eq!(graph(&grid).len(), 6 * 5 + 7 * 4 + 2 * 6 * 4);
}

#[test]
fn few_places_and_lines_have_a_graph_too() {
    assert!(graph(&[]).is_empty());
    assert!(graph(&[[3, 4, 0], [3, 4, 9]]).is_empty());
    assert_eq!(graph(&[[3, 4, 0], [-1, 2, 9], [3, 4, 1]]), BTreeSet::from([[[-1, 2], [3, 4]]]));
    let line = [[6, 3, 0], [0, 0, 0], [-2, -1, 0], [4, 2, 0]];
    assert_eq!(graph(&line), BTreeSet::from([[[-2, -1], [0, 0]], [[0, 0], [4, 2]], [[4, 2], [6, 3]]]));
}
