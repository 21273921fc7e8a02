//! Every single edge that windows leave open gets the verdict that exact arithmetic over all places gives it.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;

use std::collections::BTreeSet;

use clouds::cases;
use oracle::delaunay::{Adjacency, adjacency};
use proptest::prelude::*;
use streamseg::front::{Front, Frontier, OpenEdge, Place};
use streamseg::neighborhood::{Delaunay, Loaded};

/// Two places, the smaller first.
type Pair = [[i64; 2]; 2];

/// Slabs across a direction, some of them together a window.
#[derive(Debug, Clone, Copy)]
struct Cut {
    direction: [f64; 2],
    width: f64,
    spans: usize,
    overlap: usize,
    /// How far from zero the places are told to be.
    offset: i64,
    /// Whether the stream just stops, without telling the last window that nothing lies beyond.
    stops: bool,
}

impl Cut {
    fn told(&self, place: [i64; 2]) -> [f64; 2] {
        place.map(|c| (c + self.offset) as f64)
    }

    fn slab(&self, place: [i64; 2]) -> i64 {
        let [x, y] = self.told(place);
        ((self.direction[0] * x + self.direction[1] * y) / self.width).floor() as i64
    }
}

/// The slabs that have places, in order, with the numbers of the places.
fn slabs(places: &[[i64; 2]], cut: &Cut) -> Vec<(i64, Vec<usize>)> {
    let mut slabs: Vec<(i64, Vec<usize>)> = Vec::new();
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&i| cut.slab(places[i]));
    for i in order {
        let slab = cut.slab(places[i]);
        match slabs.last_mut() {
            Some((last, members)) if *last == slab => members.push(i),
            _ => slabs.push((slab, vec![i])),
        }
    }
    slabs
}

/// What the windows and the front say: pairs that are edges, in the end. `watch` sees the front after each window.
fn streamed(places: &[[i64; 2]], cut: &Cut, mut watch: impl FnMut(&Front)) -> BTreeSet<Pair> {
    let slabs = slabs(places, cut);
    let mut front = Front::default();
    let mut edges = BTreeSet::new();
    // Each open edge has two segments of its own, so that each join tells of one edge.
    let mut of_segment: Vec<Pair> = Vec::new();
    let mut first = 0;
    while first + cut.overlap < slabs.len() || (first == 0 && !slabs.is_empty()) {
        let end = (first + cut.spans).min(slabs.len());
        let low = if first == 0 { f64::NEG_INFINITY } else { slabs[first].0 as f64 * cut.width };
        let above = slabs.get(end).map(|(slab, _)| *slab).or(cut.stops.then(|| slabs[end - 1].0 + 1));
        let high = above.map_or(f64::INFINITY, |slab| slab as f64 * cut.width);
        let loaded = Loaded { direction: cut.direction, low, high, largest: 0.0 };
        let span_of = |i: usize| slabs.binary_search_by_key(&cut.slab(places[i]), |(slab, _)| *slab).unwrap() as u64;
        let members: Vec<usize> = slabs[first..end].iter().flat_map(|(_, members)| members.clone()).collect();
        let told: Vec<[f64; 2]> = members.iter().map(|&i| cut.told(places[i])).collect();
        let neighborhood = Delaunay::new(&told, |_| 0.0);
        let finality = neighborhood.finality(loaded);
        let member = |at: usize| members[neighborhood.order()[at] as usize];
        let place = |i: usize| Place { at: cut.told(places[i]), span: span_of(i) };
        let mut found = Vec::new();
        neighborhood.for_each_edge(|a, b, edge| found.push((a.start, b.start, edge.is_final(&finality))));
        neighborhood
            .for_each_cocircular_pair(|_| false, |a, b, edge| found.push((a.start, b.start, edge.is_final(&finality))));
        let first_segment_id = of_segment.len() as i64;
        let mut open = Vec::new();
        for (a, b, is_final) in found {
            let (i, j) = (member(a), member(b));
            let pair = [places[i].min(places[j]), places[i].max(places[j])];
            if is_final {
                edges.insert(pair);
            } else {
                let label = (of_segment.len() as i64 - first_segment_id) as i32;
                of_segment.extend([pair; 2]);
                open.push(OpenEdge { ends: [place(i), place(j)], labels: [label, label + 1] });
            }
        }
        let mut open_places = Vec::new();
        neighborhood.for_each_open_stack(&finality, |stack, _| open_places.push(place(member(stack.start))));
        let frontier = Frontier { loaded, spans: first as u64..end as u64, places: open_places, edges: open };
        let joins = front.advance(&frontier, first_segment_id);
        edges.extend(joins.iter().map(|[a, _]| of_segment[*a as usize]));
        first += cut.spans - cut.overlap;
        watch(&front);
    }
    if cut.stops {
        edges.extend(front.finish().iter().map(|[a, _]| of_segment[*a as usize]));
    }
    assert_eq!((front.waiting(), front.places(), front.asleep()), (0, 0, 0), "nothing is left undecided");
    edges
}

/// Long clouds full of voids and of places on common lines and circles.
fn places() -> impl Strategy<Value = Vec<[i64; 2]>> {
    let part = prop_oneof![
        prop::collection::vec((0i64..7, 0i64..7).prop_map(<[i64; 2]>::from), 0..20),
        prop::collection::vec((0i64..60, 0i64..7).prop_map(<[i64; 2]>::from), 0..30),
        prop::collection::vec((-60i64..60, -60i64..60).prop_map(<[i64; 2]>::from), 0..20),
        rim(),
        bow(),
        raster(),
        raster(),
    ];
    prop::collection::vec(part, 1..4).prop_map(|parts| {
        let distinct: BTreeSet<[i64; 2]> = parts.concat().into_iter().collect();
        distinct.into_iter().collect()
    })
}

/// Many of the lattice points of a large circle, with nothing inside.
fn rim() -> impl Strategy<Value = Vec<[i64; 2]>> {
    let on_rim = |r: i64| -> Vec<[i64; 2]> {
        (-r..=r).flat_map(|x| (-r..=r).map(move |y| [x, y])).filter(|[x, y]| x * x + y * y == r * r).collect()
    };
    (prop::sample::select(vec![5i64, 25, 65]), (-20i64..20, -20i64..20), any::<u64>()).prop_map(
        move |(r, (x, y), keep)| {
            let kept = on_rim(r).into_iter().enumerate().filter(|(i, _)| keep >> (i % 64) & 3 != 0);
            kept.map(|(_, [dx, dy])| [x + dx, y + dy]).collect()
        },
    )
}

/// A bow so flat that its circles are large, with a few places on either side.
fn bow() -> impl Strategy<Value = Vec<[i64; 2]>> {
    ((-9i64..9, -9i64..9), 20i64..200, any::<bool>(), 0i64..30).prop_map(|((x, y), flat, upright, count)| {
        let point = |k: i64| [x + 3 * k, y + (k - 15) * (k - 15) / flat];
        (0..count).map(point).map(|[x, y]| if upright { [y, x] } else { [x, y] }).collect()
    })
}

/// A grid or a single line, upright, oblique or sheared, whose edges are straight, with a few places beside it.
fn raster() -> impl Strategy<Value = Vec<[i64; 2]>> {
    let steps = prop::sample::select(vec![
        ([1i64, 0], [0i64, 1]),
        ([0, 1], [1, 0]),
        ([2, 0], [1, 2]),
        ([2, 1], [-1, 2]),
        ([1, 3], [1, -1]),
        ([-3, 1], [0, 1]),
    ]);
    let beside = prop::collection::vec((-9i64..50, -9i64..50).prop_map(<[i64; 2]>::from), 0..4);
    ((-9i64..9, -9i64..9), steps, 1i64..35, 1i64..4, beside).prop_map(|((x, y), (step, row), count, rows, beside)| {
        let grid = (0..rows).flat_map(|r| (0..count).map(move |k| (k, r)));
        let place = |(k, r): (i64, i64)| [x + k * step[0] + r * row[0], y + k * step[1] + r * row[1]];
        grid.map(place).chain(beside.iter().map(|[dx, dy]| [x + dx, y + dy])).collect()
    })
}

fn cut() -> impl Strategy<Value = Cut> {
    let oblique = (0.0f64..7.0).prop_map(|angle| [angle.sin(), angle.cos()]);
    let direction = prop_oneof![2 => Just([1.0, 0.0]), 2 => Just([0.0, 1.0]), 1 => oblique];
    let size = (2usize..5).prop_flat_map(|spans| (Just(spans), 0..spans));
    (direction, 1i64..20, size, prop::sample::select(vec![0i64, -30, 500_000]), any::<bool>()).prop_map(
        |(direction, width, (spans, overlap), offset, stops)| Cut {
            direction,
            width: width as f64,
            spans,
            overlap,
            offset,
            stops,
        },
    )
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn every_edge_gets_its_verdict(places in places(), cut in cut()) {
        let found = streamed(&places, &cut, |_| ());
        let points: Vec<[i64; 3]> = places.iter().map(|&[x, y]| [x, y, 0]).collect();
        for i in 0..places.len() {
            for j in 0..i {
                let pair = [places[i].min(places[j]), places[i].max(places[j])];
                let is_edge = adjacency(&points, i, j) != Adjacency::None;
                prop_assert!(is_edge || !found.contains(&pair), "{:?} is no edge", pair);
                let apart = (0..2).map(|k| ((pair[1][k] - pair[0][k]) as f64).powi(2)).sum::<f64>().sqrt();
                let shares = apart * (1.0 + 1e-9) <= cut.width * cut.overlap as f64;
                prop_assert!(!(is_edge && shares) || found.contains(&pair), "{:?} is an edge", pair);
            }
        }
    }
}

fn across(direction: [f64; 2]) -> Cut {
    Cut { direction, width: 10.0, spans: 3, overlap: 1, offset: 0, stops: true }
}

/// Columns of a grid, `rows` high.
fn grid(columns: i64, rows: i64) -> Vec<[i64; 2]> {
    (0..columns).flat_map(|x| (0..rows).map(move |y| [x, y])).collect()
}

/// The most places that are ever kept awake.
fn most_kept(places: &[[i64; 2]], cut: &Cut) -> usize {
    let mut most = 0;
    streamed(places, cut, |front| most = most.max(front.places()));
    most
}

/// What is triangulated again and again does not grow with the straight edges of a cloud.
#[test]
fn a_straight_edge_sleeps() {
    for direction in [[1.0, 0.0], [0.75f64.sqrt(), 0.5], [0.6, 0.8]] {
        for rows in [1, 2, 20] {
            let kept = [500, 1000, 2000].map(|columns| most_kept(&grid(columns, rows), &across(direction)));
            assert!(kept[2] < kept[1] + 100 && kept[1] < kept[0] + 100, "{direction:?} {rows}: {kept:?}");
        }
    }
    for direction in [[0.0, 1.0], [0.5, 0.75f64.sqrt()]] {
        let kept = [500, 1000].map(|rows| most_kept(&grid(20, rows), &across(direction)));
        assert!(kept[1] < kept[0] + 100, "{direction:?}: {kept:?}");
    }
}

/// A place beyond a straight edge that sleeps wakes all of it, and has an edge to all of it.
#[test]
fn a_place_beyond_wakes_a_straight_edge() {
    for rows in [1, 5] {
        for y in [-1000, 1000] {
            let places = [grid(200, rows), vec![[215, y]]].concat();
            let mut asleep = Vec::new();
            let cut = Cut { overlap: 2, ..across([1.0, 0.0]) };
            let found = streamed(&places, &cut, |front| asleep.push(front.asleep()));
            let edge = if y > 0 { rows - 1 } else { 0 };
            assert!((190..200).all(|x| found.contains(&[[x, edge], [215, y]])), "{found:?}");
            let [.., before, after] = asleep[..] else { panic!("{asleep:?}") };
            assert!(before > 100 && after + 100 < before, "{asleep:?}");
        }
    }
}
