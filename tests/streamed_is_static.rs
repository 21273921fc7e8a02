//! The streamed result against the static one, and both against slow oracles on whole numbers.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::sync::Arc;

use clouds::{Place, Survey, cases, cloud, squared_distance, survey};
use oracle::delaunay::{Adjacency, adjacency, is_gabriel};
use oracle::partition::{canonical, components, refines};
use oracle::radius::{pairs_within, squared_length};
use proptest::prelude::*;
use streaming::{Outcome, Run, static_labels, stream};
use streamseg::expression::Filter;
use streamseg::features::Fit;
use streamseg::label::NONE;
use streamseg::lattice::{Lattice, Metric};
use streamseg::recipe::{Ingredients, Recipe};
use streamseg::scene::{OFFSET, SCALE, Scene};
use streamseg::segmentor::{Proximity, Segmentor};
use streamseg::span::{Direction, Source, SpanBy};
use streamseg::weaver::SegmentRow;
use streamseg::window::WindowSize;

fn window_size() -> impl Strategy<Value = WindowSize> {
    (1usize..6).prop_flat_map(|spans| (Just(spans), 0..spans)).prop_map(|(s, o)| WindowSize::new(s, o).unwrap())
}

fn overlapping_window_size() -> impl Strategy<Value = WindowSize> {
    (2usize..6).prop_flat_map(|spans| (Just(spans), 1..spans)).prop_map(|(s, o)| WindowSize::new(s, o).unwrap())
}

fn direction() -> impl Strategy<Value = Direction> {
    prop_oneof![
        Just(Direction::X),
        Just(Direction::Y),
        prop::sample::select(vec![0.0, 45.0, 90.0, -30.0]).prop_map(Direction::Azimuth),
        (-360.0f64..360.0).prop_map(Direction::Azimuth),
    ]
}

fn chunk_sizes() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(0usize..20, 0..4).prop_map(|sizes| [sizes, vec![7]].concat())
}

/// Cuts by count or as given, from a live source or a stored one.
fn cut_along_the_stream() -> impl Strategy<Value = (SpanBy, Source)> {
    let by = prop_oneof![(1usize..30).prop_map(|points| SpanBy::Count { points }), Just(SpanBy::Given)];
    (by, prop::sample::select(vec![Source::Live, Source::Stored]))
}

fn proximity(squared: i64, metric: Metric, survey: &Survey) -> Proximity {
    Proximity::new((squared as f64).sqrt() * survey.unit, metric).unwrap()
}

/// The segmentor, after a filter if there is one.
fn filtered(segmentor: Proximity, filter: Option<&str>) -> Arc<dyn Segmentor> {
    let filter = filter.map(|text| Filter::parse(text).unwrap());
    let segmentor = Arc::new(segmentor);
    let ingredients = Ingredients { stages: vec![], filter, seed_filter: None, fit: Fit::default(), segmentor };
    Arc::new(Recipe::new(ingredients, &[], false).unwrap())
}

/// Spans so wide that the overlap holds the distance: exactly, or with some steps to spare.
fn wide_enough(distance: f64, spare: i64, size: WindowSize, direction: Direction, survey: &Survey) -> SpanBy {
    let width = distance / size.overlap() as f64;
    let exact = direction == Direction::X && survey.lattice.is_whole() && width.fract() == 0.0;
    let width = if exact { width + spare as f64 } else { width * (1.0 + 2e-6) + spare as f64 };
    SpanBy::Width { width: width * survey.unit, direction }
}

/// What holds for the ids of every run, whatever the segmentor.
fn check_ids(outcome: &Outcome) -> Result<(), TestCaseError> {
    prop_assert_eq!(&outcome.resolved_raw, &outcome.resolved_carried);
    prop_assert_eq!(&outcome.resolved_raw, &outcome.settled);
    prop_assert_eq!(&outcome.resolved_raw, &outcome.with_aliases);
    prop_assert_eq!(&outcome.resolved_raw, &smallest_of_component(&outcome.raw, &outcome.rows));
    Ok(())
}

/// Final ids from the history alone.
fn smallest_of_component(raw: &[i64], rows: &[SegmentRow]) -> Vec<i64> {
    let last = rows.iter().map(|row| row.segment_id).max().unwrap_or(0);
    let joined = rows.iter().filter(|row| row.next_segment_id != NONE);
    let of = components(last as usize + 1, joined.map(|row| (row.segment_id as usize, row.next_segment_id as usize)));
    raw.iter().map(|&id| if id == NONE { NONE } else { of[id as usize] }).collect()
}

/// Pairs that are joined if their places are related as `allowed`: within the distance in space.
fn pairs_on_the_map(points: &[Place], squared: i64, allowed: &[Adjacency]) -> Vec<(usize, usize)> {
    let mut pairs = pairs_within(points, squared, 3);
    pairs.retain(|&(a, b)| allowed.contains(&adjacency(points, a, b)));
    pairs
}

proptest! {
    #![proptest_config(cases(192))]

    /// Class A: with every pair in reach in one window, streamed = static = the radius graph.
    #[test]
    fn on_the_map_streamed_is_static_is_the_radius_graph(
        cloud in cloud(), survey in survey(), squared in squared_distance(), size in overlapping_window_size(),
        spare in prop::sample::select(vec![0i64, 1, 7, 40]), direction in direction(), chunks in chunk_sizes(),
        threads in prop::sample::select(vec![1usize, 2, 4]),
    ) {
        let points = survey.told(&cloud);
        let segmentor = proximity(squared, Metric::Xy, &survey);
        let radius_graph = components(cloud.len(), pairs_within(&survey.in_units(&cloud), squared, 2));
        prop_assert_eq!(
            canonical(&static_labels(&points, survey.lattice, &segmentor)), canonical(&radius_graph)
        );
        let by = wide_enough((squared as f64).sqrt(), spare, size, direction, &survey);
        let assessment = segmentor.exactness().assess(by, size, &survey.lattice);
        prop_assert!(assessment.is_identical, "{:?}", assessment);
        let run = Run { by, size, source: Source::Stored, chunks, threads };
        let outcome = stream(&points, survey.lattice, Arc::new(segmentor), &run);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&radius_graph));
        check_ids(&outcome)?;
    }

    /// The same from a live source, which has to come sorted.
    #[test]
    fn a_sorted_live_source_gives_what_a_stored_one_gives(
        cloud in cloud(), survey in survey(), squared in squared_distance(), size in window_size(),
        width in 1i64..40, chunks in chunk_sizes(), metric in prop::sample::select(vec![Metric::Xy, Metric::Xyz]),
    ) {
        let mut cloud = cloud;
        cloud.sort_by_key(|place| place[0]);
        let points = survey.told(&cloud);
        let by = SpanBy::Width { width: width as f64 * survey.unit, direction: Direction::X };
        let outcome = |source, chunks| {
            let run = Run { by, size, source, chunks, threads: 1 };
            stream(&points, survey.lattice, Arc::new(proximity(squared, metric, &survey)), &run)
        };
        let live = outcome(Source::Live, chunks);
        prop_assert_eq!(&live, &outcome(Source::Stored, vec![1000]));
        check_ids(&live)?;
    }

    /// However the stream is cut, segments are only ever split, never merged, and the ids are consistent.
    #[test]
    fn on_the_map_any_cut_splits_but_never_merges(
        cloud in cloud(), survey in survey(), squared in squared_distance(), size in window_size(),
        (by, source) in cut_along_the_stream(), chunks in chunk_sizes(),
    ) {
        let points = survey.told(&cloud);
        let run = Run { by, size, source, chunks, threads: 1 };
        let outcome = stream(&points, survey.lattice, Arc::new(proximity(squared, Metric::Xy, &survey)), &run);
        let radius_graph = components(cloud.len(), pairs_within(&survey.in_units(&cloud), squared, 2));
        prop_assert!(refines(&outcome.settled, &radius_graph));
        if outcome.spans.len() <= size.spans() {
            prop_assert_eq!(canonical(&outcome.settled), canonical(&radius_graph));
        }
        check_ids(&outcome)?;
    }

    /// Ids, not only partitions, are the same for any number of threads and any way in which the source delivers.
    #[test]
    fn ids_depend_neither_on_threads_nor_on_chunks(
        cloud in cloud(), survey in survey(), squared in squared_distance(), size in window_size(),
        direction in direction(), width in 1i64..40, count in prop::option::of(1usize..30), chunks in chunk_sizes(),
        metric in prop::sample::select(vec![Metric::Xy, Metric::Xyz]),
    ) {
        let points = survey.told(&cloud);
        let by = match count {
            Some(points) => SpanBy::Count { points },
            None => SpanBy::Width { width: width as f64 * survey.unit, direction },
        };
        let outcome = |threads, chunks| {
            let run = Run { by, size, source: Source::Stored, chunks, threads };
            stream(&points, survey.lattice, Arc::new(proximity(squared, metric, &survey)), &run)
        };
        let first = outcome(1, vec![points.len().max(1)]);
        for (threads, chunks) in [(1, chunks.clone()), (2, vec![1]), (4, chunks)] {
            prop_assert_eq!(&outcome(threads, chunks), &first, "{} threads", threads);
        }
    }

    /// With lengths in space, pairs that are in some triangulation are joined, whichever the triangulator has chosen. Where
    /// rounding has moved places apart from their common circle, those that are in every triangulation are sure.
    #[test]
    fn in_space_static_is_canonical(
        cloud in cloud(), survey in survey(), squared in squared_distance(),
    ) {
        let units = survey.in_units(&cloud);
        let found = static_labels(&survey.told(&cloud), survey.lattice, &proximity(squared, Metric::Xyz, &survey));
        let [strict, weak] = [
            &[Adjacency::Coincident, Adjacency::Strict][..],
            &[Adjacency::Coincident, Adjacency::Strict, Adjacency::Weak][..],
        ].map(|allowed| components(units.len(), pairs_on_the_map(&units, squared, allowed)));
        prop_assert!(refines(&strict, &found), "a pair of every triangulation is missing");
        prop_assert!(!survey.is_exact_on_the_map() || canonical(&found) == canonical(&weak), "not the canonical graph");
    }

    /// Class B: with every pair in reach in one window, all edges are decided, and streamed = static. Also if a filter
    /// leaves points out.
    #[test]
    fn in_space_streamed_is_static_and_proves_it(
        cloud in cloud(), survey in survey(), squared in squared_distance(), size in overlapping_window_size(),
        spare in prop::sample::select(vec![0i64, 1, 7, 40]), direction in direction(), chunks in chunk_sizes(),
        threads in prop::sample::select(vec![1usize, 2]), filter in prop::sample::select(vec![None, Some("Z >= 0")]),
    ) {
        let points = survey.told(&cloud);
        let segmentor = filtered(proximity(squared, Metric::Xyz, &survey), filter);
        let expected = static_labels(&points, survey.lattice, &*segmentor);
        let by = wide_enough((squared as f64).sqrt(), spare, size, direction, &survey);
        let assessment = segmentor.exactness().assess(by, size, &survey.lattice);
        prop_assert!(assessment.is_identical, "{:?}", assessment);
        let run = Run { by, size, source: Source::Stored, chunks, threads };
        let outcome = stream(&points, survey.lattice, segmentor, &run);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&expected));
        prop_assert!(outcome.certificate.is_complete(), "{:?}", outcome.certificate);
        check_ids(&outcome)?;
    }

    /// Class B: a streamed run joins no pair that some triangulation of the whole cloud lacks, and every pair whose
    /// smallest circle is empty and lies inside one window.
    #[test]
    fn in_space_streamed_joins_what_an_empty_circle_proves_and_nothing_else(
        cloud in cloud(), survey in survey(), squared in squared_distance(), size in window_size(),
        direction in direction(), width in 1i64..60, chunks in chunk_sizes(),
    ) {
        let units = survey.in_units(&cloud);
        let by = SpanBy::Width { width: width as f64 * survey.unit, direction };
        let run = Run { by, size, source: Source::Stored, chunks, threads: 1 };
        let segmentor = Arc::new(proximity(squared, Metric::Xyz, &survey));
        let outcome = stream(&survey.told(&cloud), survey.lattice, segmentor, &run);
        check_ids(&outcome)?;

        let weak = [Adjacency::Coincident, Adjacency::Strict, Adjacency::Weak];
        let in_some = components(units.len(), pairs_on_the_map(&units, squared, &weak));
        let is_exact = survey.is_exact_on_the_map();
        prop_assert!(!is_exact || refines(&outcome.settled, &in_some), "a pair of no triangulation was joined");
        let mut proven = pairs_within(&units, squared, 3);
        proven.retain(|&(a, b)| is_proven(&units, (a, b), direction, width, size, &survey));
        prop_assert!(refines(&components(units.len(), proven), &outcome.settled), "a proven pair is missing");
    }
}

/// Whether the pair is of one place, or its smallest circle is empty and lies so far inside some window that no rounding
/// can matter.
fn is_proven(
    units: &[Place],
    (a, b): (usize, usize),
    direction: Direction,
    width: i64,
    size: WindowSize,
    survey: &Survey,
) -> bool {
    if adjacency(units, a, b) == Adjacency::Coincident {
        return true;
    }
    let toward = match direction {
        Direction::X => [1.0, 0.0],
        Direction::Y => [0.0, 1.0],
        Direction::Azimuth(degrees) => [degrees.to_radians().sin(), degrees.to_radians().cos()],
    };
    let offset = survey.told(&[[0; 3]])[0];
    let offset = if survey.lattice.is_whole() { survey.lattice.offset() } else { offset };
    let way = |p: Place| (0..2).map(|k| toward[k] * (p[k] as f64 + offset[k] / survey.unit)).sum::<f64>();
    let middle = f64::midpoint(way(units[a]), way(units[b]));
    let radius = (squared_length(units[a], units[b], 2) as f64).sqrt() / 2.0;
    let slab = |way: f64| (way / width as f64).floor();
    let (low, high) = (slab(middle - radius - 1e-3), slab(middle + radius + 1e-3));
    is_gabriel(units, a, b) && high - low <= size.overlap() as f64
}

/// Found by the property above: in real numbers far from the origin a line is not quite straight, and its triangles are
/// so thin that rounding turns their corners to the other side. The pairs along it are proven all the same.
#[test]
fn pairs_along_a_line_that_rounding_bends_are_joined() {
    let points: Vec<[f64; 3]> =
        (0..100).map(|k| [500_000.0 + f64::from(k) * 0.01, 5_400_000.0 + f64::from(4 * k) * 0.01, 0.0]).collect();
    let by = SpanBy::Width { width: 0.07, direction: Direction::X };
    let run = Run { by, size: WindowSize::default(), source: Source::Stored, chunks: vec![7], threads: 1 };
    let outcome = stream(&points, Lattice::REAL, Arc::new(Proximity::new(0.05, Metric::Xyz).unwrap()), &run);
    assert!(outcome.settled.iter().all(|&id| id == 1), "{:?}", outcome.settled);
}

/// Two places that only differ below the least coordinate that spade takes are one vertex to it.
#[test]
fn places_that_differ_by_next_to_nothing_do_not_shift_the_others() {
    let mut points = vec![[0.0, 0.0, 0.0], [1e-50, 0.0, 0.0], [0.0, 1e-50, 0.0]];
    points.extend((0..8).map(|i| [f64::from(10 + i), f64::from(i % 3), 0.0]));
    let found = static_labels(&points, Lattice::REAL, &Proximity::new(3.0, Metric::Xy).unwrap());
    assert_eq!(canonical(&found), [0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1]);
}

/// Streams large enough that several threads weave one window.
#[test]
fn ids_do_not_depend_on_threads_where_windows_are_large() {
    let lattice = Lattice::new([SCALE; 3], OFFSET).unwrap();
    let points: Vec<[f64; 3]> = Scene::street(11).take(150_000).map(|point| point.position.map(f64::from)).collect();
    let by = SpanBy::Width { width: 2.0, direction: Direction::X };
    let outcome = |threads, chunk| {
        let size = WindowSize::new(6, 2).unwrap();
        let run = Run { by, size, source: Source::Stored, chunks: vec![chunk], threads };
        stream(&points, lattice, Arc::new(Proximity::new(0.3, Metric::Xyz).unwrap()), &run)
    };
    let first = outcome(1, 150_000);
    assert!(first.spans.iter().max() > Some(&5_000));
    check_ids(&first).unwrap();
    for (threads, chunk) in [(2, 4_096), (4, 999)] {
        assert_eq!(outcome(threads, chunk), first, "{threads} threads");
    }
}
