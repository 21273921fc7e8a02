//! Slabs that are handed on while the stream is still being read: against a naive twin, and through the whole pipeline.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use clouds::{cases, cloud, squared_distance, survey};
use oracle::partition::canonical;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use streaming::{chunks_of, gather, point_ids, static_labels};
use streamseg::crew::Crew;
use streamseg::error::{Error, Result};
use streamseg::features::Fit;
use streamseg::lattice::{Lattice, Metric};
use streamseg::pipeline::Pipeline;
use streamseg::recipe::{Ingredients, Recipe};
use streamseg::segmentor::{Dbscan, RegionGrowing, Segmentor};
use streamseg::span::{Chunk, Counting, Direction, SlabCounts, Span, SpanBy, SpanSource, finalized_spans_of};
use streamseg::window::WindowSize;

type Points = Vec<[f64; 3]>;

fn counted(points: &[[f64; 3]], width: f64, lattice: &Lattice, sizes: &[usize]) -> SlabCounts {
    let mut counting = Counting::new(width, lattice).unwrap();
    chunks_of(points, sizes).iter().for_each(|chunk| counting.add(chunk).unwrap());
    counting.finish()
}

/// How spans are cut in stream order; what is given comes in chunks.
fn cut() -> impl Strategy<Value = SpanBy> {
    prop_oneof![(1usize..40).prop_map(|points| SpanBy::Count { points }), Just(SpanBy::Given)]
}

fn chunk_sizes() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(0usize..20, 0..4).prop_map(|sizes| [sizes, vec![7]].concat())
}

/// Slabs of whole numbers, by their oracle.
fn slab_of(point: &[f64; 3], width: i64, direction: Direction) -> i64 {
    let way = match direction {
        Direction::X => point[0],
        Direction::Y => point[1],
        Direction::Azimuth(270.0) => -point[0],
        Direction::Azimuth(180.0) => -point[1],
        Direction::Azimuth(_) => panic!("not along an axis"),
    };
    (way as i64).div_euclid(width)
}

/// The last point of each slab and of all before it: the slab is final when it has come.
fn final_after(points: &[[f64; 3]], width: i64, direction: Direction) -> BTreeMap<i64, usize> {
    let mut last = BTreeMap::new();
    for (id, point) in points.iter().enumerate() {
        last.insert(slab_of(point, width, direction), id);
    }
    let mut latest = 0;
    last.into_iter().map(|(slab, last)| (slab, { latest = latest.max(last); latest })).collect()
}

/// How many points wait at the most when they come one by one: after each point, those whose slab is not final yet.
fn most_waiting(points: &[[f64; 3]], width: i64, direction: Direction) -> u64 {
    let finals = final_after(points, width, direction);
    let of_point = |id: usize| finals[&slab_of(&points[id], width, direction)];
    // The last point of a slab waits for nothing, but has come before any is handed on.
    (0..points.len()).map(|now| (0..=now).filter(|&id| of_point(id) >= now).count() as u64).max().unwrap_or(0)
}

const DIRECTIONS: [Direction; 4] =
    [Direction::X, Direction::Y, Direction::Azimuth(270.0), Direction::Azimuth(180.0)];

/// Clouds that mostly follow a direction, as a survey does, or are in any order.
fn in_some_order() -> impl Strategy<Value = Points> {
    (cloud(), 0usize..6).prop_map(|(mut cloud, order)| {
        match order {
            0 => cloud.sort_by_key(|place| place[0]),
            1 => cloud.sort_by_key(|place| -place[0]),
            2 => cloud.sort_by_key(|place| place[1].div_euclid(10)),
            3 => cloud.sort_by_key(|place| -place[1].div_euclid(10)),
            _ => {}
        }
        cloud.into_iter().map(|place| place.map(|c| c as f64)).collect()
    })
}

/// The spans, and how many points of the source had been asked for when each came.
fn spans_as_they_come(
    points: &[[f64; 3]],
    by: SpanBy,
    sizes: &[usize],
    counts: &SlabCounts,
) -> (Vec<(Span, usize)>, Option<Error>) {
    let asked = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&asked);
    let chunks = chunks_of(points, sizes).into_iter().map(move |chunk| {
        counter.fetch_add(chunk.points.len(), Ordering::Relaxed);
        Ok(chunk)
    });
    let mut spans = finalized_spans_of(chunks, by, &Lattice::REAL, counts).unwrap();
    let (mut come, mut failure) = (vec![], None);
    while let Some(span) = spans.next() {
        match span {
            Ok(span) => come.push((span, asked.load(Ordering::Relaxed))),
            Err(error) => assert!(failure.replace(error).is_none()),
        }
    }
    (come, failure)
}

proptest! {
    #![proptest_config(cases(192))]

    /// Fewest points wait along the direction that was chosen, and as many as were told.
    #[test]
    fn the_direction_is_the_one_in_which_fewest_wait(
        points in in_some_order(), width in 1i64..40, sizes in chunk_sizes(),
    ) {
        let counts = counted(&points, width as f64, &Lattice::REAL, &sizes);
        let waiting = DIRECTIONS.map(|direction| most_waiting(&points, width, direction));
        prop_assert_eq!(counts.points(), points.len() as u64);
        prop_assert_eq!(Some(&counts.most_waiting()), waiting.iter().min());
        let chosen = DIRECTIONS.iter().position(|&direction| direction == counts.direction());
        prop_assert_eq!(chosen, waiting.iter().position(|&most| most == counts.most_waiting()));
    }

    /// Each point comes out once, in its slab; slabs come in order, and each when its last point and those of all slabs
    /// before it have been read: not earlier, and not later than the span in which the last of them came.
    #[test]
    fn slabs_come_as_soon_as_they_are_final(
        points in in_some_order(), width in 1i64..40, by in cut(), sizes in chunk_sizes(), other_sizes in chunk_sizes(),
    ) {
        let counts = counted(&points, width as f64, &Lattice::REAL, &other_sizes);
        let direction = counts.direction();
        let finals = final_after(&points, width, direction);
        let (come, failure) = spans_as_they_come(&points, by, &sizes, &counts);
        prop_assert!(failure.is_none());
        prop_assert_eq!(come.len(), finals.len());

        let span_points = match by { SpanBy::Count { points } => points, _ => 1 };
        let largest_chunk = sizes.iter().copied().max().unwrap();
        let mut high = f64::NEG_INFINITY;
        for (index, ((span, asked), (&slab, &last))) in come.iter().zip(&finals).enumerate() {
            prop_assert_eq!(span.index, index as u64);
            let expected: Vec<i64> =
                (0..points.len()).filter(|&id| slab_of(&points[id], width, direction) == slab).map(|id| id as i64).collect();
            prop_assert_eq!(point_ids(span), expected.clone());
            prop_assert!(expected.iter().zip(&span.points).all(|(&id, point)| points[id as usize] == *point));
            let extent = span.extent.unwrap();
            prop_assert_eq!(extent.low, high);
            high = extent.high;
            let next = finals.range(slab + 1..).next();
            prop_assert_eq!(high, next.map_or(f64::INFINITY, |(next, _)| (next * width) as f64));
            prop_assert!(*asked > last, "handed on before its last point");
            prop_assert!(*asked <= last + span_points + largest_chunk, "{} asked, final after {}", asked, last);
        }
        prop_assert_eq!(come.iter().map(|(span, _)| span.len()).sum::<usize>(), points.len());
    }

    /// Points that had come in an earlier span than the one that made their slab final, and no others, are said to have waited.
    #[test]
    fn those_that_waited_are_counted(
        points in in_some_order(), width in 1i64..40, span_points in 1usize..40, sizes in chunk_sizes(),
    ) {
        let counts = counted(&points, width as f64, &Lattice::REAL, &sizes);
        let by = SpanBy::Count { points: span_points };
        let chunks = chunks_of(&points, &sizes).into_iter().map(Ok);
        let mut spans = finalized_spans_of(chunks, by, &Lattice::REAL, &counts).unwrap();
        spans.by_ref().for_each(drop);
        let finals = final_after(&points, width, counts.direction());
        let waits = |id: usize, until: usize| {
            finals[&slab_of(&points[id], width, counts.direction())] / span_points > until / span_points
        };
        let waited = (0..points.len()).filter(|&id| waits(id, id)).count() as u64;
        let ends = (0..points.len()).map(|id| (id + 1).min(points.len()));
        let most = ends.map(|end| (0..end).filter(|&id| waits(id, end - 1)).count() as u64);
        // Looked at where a span ends.
        let most = most.enumerate().filter(|(id, _)| (id + 1) % span_points == 0).map(|(_, most)| most).max().unwrap_or(0);
        prop_assert_eq!(spans.waits().points, waited);
        prop_assert_eq!(spans.waits().most, most);
        prop_assert!(most <= counts.most_waiting());
    }

    /// A source that brings other points at the second time is told, and no point of those is lost.
    #[test]
    fn another_cloud_at_the_second_time_is_told(
        points in in_some_order(), others in in_some_order(), width in 1i64..40, by in cut(), sizes in chunk_sizes(),
    ) {
        let counts = counted(&points, width as f64, &Lattice::REAL, &sizes);
        let (come, failure) = spans_as_they_come(&others, by, &sizes, &counts);
        let mut ids: Vec<i64> = come.iter().flat_map(|(span, _)| point_ids(span)).collect();
        ids.sort_unstable();
        let read = come.last().map_or(0, |(_, asked)| *asked);
        let slabs = |cloud: &[[f64; 3]]| {
            let mut slabs: Vec<i64> = cloud.iter().map(|point| slab_of(point, width, counts.direction())).collect();
            slabs.sort_unstable();
            slabs
        };
        let same = slabs(&points) == slabs(&others);
        prop_assert_eq!(failure.is_none(), same);
        if let Some(failure) = failure {
            prop_assert!(matches!(failure, Error::Changed { .. }), "{}", failure);
        }
        // All that was read comes out, but for what the cutter still held of a chunk.
        prop_assert!(ids.iter().enumerate().all(|(i, &id)| i as i64 == id));
        prop_assert!(ids.len() <= read.max(others.len()) && (!same || ids.len() == others.len()));
    }
}

fn growing(radius: f64) -> Arc<dyn Segmentor> {
    let segmentor = Arc::new(RegionGrowing::new(6, Some(radius)).unwrap());
    let ingredients = Ingredients { stages: vec![], filter: None, seed_filter: None, fit: Fit::default(), segmentor };
    Arc::new(Recipe::new(ingredients, &[], false).unwrap())
}
