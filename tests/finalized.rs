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
use streaming::{Run, chunks_of, outcome, point_ids, static_labels, stream};
use streamseg::crew::Crew;
use streamseg::error::Error;
use streamseg::features::Fit;
use streamseg::lattice::{Lattice, Metric};
use streamseg::neighborhood::Search;
use streamseg::pipeline::Pipeline;
use streamseg::preprocessing::{Representative, Stage, VoxelGrid};
use streamseg::recipe::{Ingredients, Recipe};
use streamseg::segmentor::{Dbscan, Growth, Proximity, RegionGrowing, Segmentor};
use streamseg::span::{Counting, Direction, SlabCounts, Source, Span, SpanBy, finalized_spans_of};
use streamseg::weaver::Selection;
use streamseg::window::WindowSize;

type Points = Vec<[f64; 3]>;

fn counted(points: &[[f64; 3]], width: f64, lattice: &Lattice, sizes: &[usize]) -> SlabCounts {
    let mut counting = Counting::new(width, lattice).unwrap();
    for chunk in chunks_of(points, sizes) {
        counting.add(&chunk).unwrap();
    }
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
    last.into_iter()
        .map(|(slab, last)| {
            (slab, {
                latest = latest.max(last);
                latest
            })
        })
        .collect()
}

/// How many points wait at the most when they come one by one: after each point, those whose slab is not final yet.
fn most_waiting(points: &[[f64; 3]], width: i64, direction: Direction) -> u64 {
    let finals = final_after(points, width, direction);
    let of_point = |id: usize| finals[&slab_of(&points[id], width, direction)];
    // The last point of a slab waits for nothing, but has come before any is handed on.
    (0..points.len()).map(|now| (0..=now).filter(|&id| of_point(id) >= now).count() as u64).max().unwrap_or(0)
}

const DIRECTIONS: [Direction; 4] = [Direction::X, Direction::Y, Direction::Azimuth(270.0), Direction::Azimuth(180.0)];

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
    let spans = finalized_spans_of(chunks, by, &Lattice::REAL, counts).unwrap();
    let (mut come, mut failure) = (vec![], None);
    for span in spans {
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
        // All that was read comes out, but for what of a chunk had not become a span.
        prop_assert!(ids.iter().enumerate().all(|(i, &id)| i as i64 == id));
        let open = match by {
            SpanBy::Count { points } if !same => points + sizes.iter().max().unwrap_or(&0),
            _ => 0,
        };
        prop_assert!(ids.len() <= read && ids.len() + open >= read, "{} of {}", ids.len(), read);
    }
}

fn prepared(stages: Vec<Arc<dyn Stage>>, segmentor: Arc<dyn Segmentor>) -> Arc<dyn Segmentor> {
    let ingredients = Ingredients { stages, filter: None, seed_filter: None, fit: Fit::default(), segmentor };
    Arc::new(Recipe::new(ingredients, &[], false).unwrap())
}

/// Segmentors whose decisions more points can undo: edges in space, DBSCAN, computed normals, voxels.
fn segmentor(kind: usize, length: f64) -> Arc<dyn Segmentor> {
    match kind {
        0 => Arc::new(Proximity::new(length, Metric::Xyz).unwrap()),
        1 => Arc::new(Dbscan::new(length, 3, Metric::Xyz).unwrap()),
        2 => {
            let search = Search::nearest(5, Some(length)).unwrap();
            let growth = Growth { search, angle_deg: 20.0, ..Growth::default() };
            prepared(vec![], Arc::new(RegionGrowing::new(growth).unwrap()))
        }
        _ => {
            let voxels = Arc::new(VoxelGrid::new(length, Representative::Centroid).unwrap());
            prepared(vec![voxels], Arc::new(Proximity::new(length, Metric::Xy).unwrap()))
        }
    }
}

proptest! {
    #![proptest_config(cases(256))]

    /// In any order of the points, cut in stream order as one likes, the streamed result is the static one.
    #[test]
    fn in_any_order_of_the_stream_the_result_is_the_static_one(
        cloud in cloud(), survey in survey(), squared in squared_distance(), kind in 0usize..4, spare in 0i64..9,
        by in cut(), size in (2usize..5).prop_flat_map(|spans| (Just(spans), 1..spans)), sizes in chunk_sizes(),
        threads in 1usize..4,
    ) {
        let points = survey.told(&cloud);
        let length = (squared as f64).sqrt() * survey.unit;
        let segmentor = segmentor(kind, length);
        prop_assert!(!segmentor.exactness().is_monotone() && segmentor.exactness().is_bounded());
        // More than the reach of all of them.
        let width = (5.0 * length) * (1.0 + 1e-5) + spare as f64 * survey.unit;
        let counts = counted(&points, width, &survey.lattice, &sizes);
        let size = WindowSize::new(size.0, size.1).unwrap();
        let assessment = segmentor.exactness().assess(counts.by(), size, &survey.lattice).finalized();
        prop_assert!(assessment.is_identical, "{:?}", assessment);

        let spans = finalized_spans_of(chunks_of(&points, &sizes).into_iter().map(Ok), by, &survey.lattice, &counts);
        let crew = Crew::new(threads).unwrap();
        let pipeline = Pipeline::new(spans.unwrap(), survey.lattice, Arc::clone(&segmentor), size, crew);
        let outcome = outcome(pipeline, points.len());
        let expected = static_labels(&points, survey.lattice, &*segmentor);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&expected));
        prop_assert!(outcome.certificate.is_complete(), "{:?}", outcome.certificate);
    }
}

/// Without waiting, spans in the order of a stream that comes back split what belongs together: so the property above can fail.
#[test]
fn without_waiting_a_stream_that_comes_back_is_split() {
    // One row there, another back, half a step beside it.
    let there = (0..100).map(|i| [f64::from(i), 0.0, 0.0]);
    let back = (0..100).rev().map(|i| [f64::from(i), 0.5, 0.0]);
    let points: Points = there.chain(back).collect();
    let dbscan: Arc<dyn Segmentor> = Arc::new(Dbscan::new(0.8, 2, Metric::Xyz).unwrap());
    let expected = canonical(&static_labels(&points, Lattice::REAL, &*dbscan));
    let (by, size) = (SpanBy::Count { points: 10 }, WindowSize::default());
    let run = Run { by, size, source: Source::Stored, chunks: vec![7], threads: 1 };
    assert_ne!(canonical(&stream(&points, Lattice::REAL, Arc::clone(&dbscan), &run).settled), expected);

    let counts = counted(&points, 4.0, &Lattice::REAL, &[7]);
    let chunks = chunks_of(&points, &[7]).into_iter().map(Ok);
    let spans = finalized_spans_of(chunks, by, &Lattice::REAL, &counts).unwrap();
    let mut pipeline = Pipeline::new(spans, Lattice::REAL, dbscan, size, Crew::new(1).unwrap());
    let mut finals = vec![-1; points.len()];
    for out in pipeline.by_ref().map(Result::unwrap) {
        point_ids(&out.span)
            .iter()
            .zip(&out.segmented.carried_ids)
            .for_each(|(&id, &carried)| finals[id as usize] = carried);
    }
    pipeline.aliases().resolve(&mut finals, &Selection::default()).unwrap();
    assert_eq!(canonical(&finals), expected);
    // All that came on the way there had to wait, and on the way back those in whose slab a span ends.
    let certificate = pipeline.certificate();
    assert_eq!((counts.direction(), certificate.most_waiting), (Direction::Azimuth(270.0), 100));
    assert!((100..125).contains(&certificate.waited_points), "{certificate:?}");
}

#[test]
fn a_stopped_source_hands_on_nothing_that_has_holes() {
    let points: Points = (0..100).map(|i| [f64::from(i % 50), 0.0, 0.0]).collect();
    let counts = counted(&points, 10.0, &Lattice::REAL, &[7]);
    let chunks = chunks_of(&points, &[7]).into_iter().map(Ok);
    let mut spans = finalized_spans_of(chunks, SpanBy::Count { points: 5 }, &Lattice::REAL, &counts).unwrap();
    assert_eq!(spans.next().unwrap().unwrap().len(), 20);
    spans.stop();
    assert!(spans.next().is_none());
}

#[test]
fn a_failing_source_is_told_after_what_was_final() {
    let points: Points = (0..100).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let counts = counted(&points, 10.0, &Lattice::REAL, &[7]);
    let failing = (0..).map(move |i| {
        if i == 5 { Err(Error::Foreign("gone".into())) } else { Ok(streaming::chunk(&points[7 * i..7 * i + 7])) }
    });
    let by = SpanBy::Count { points: 5 };
    let mut spans = finalized_spans_of(failing, by, &Lattice::REAL, &counts).unwrap();
    // The slabs from 0 to 10, 20 and 30; of the fourth only half has come.
    let come: Vec<usize> = spans.by_ref().map_while(Result::ok).map(|span| span.len()).collect();
    assert_eq!(come, [10, 10, 10]);
    assert!(spans.next().is_none());
}
