//! The segmentors over the radius graph: static against measuring all pairs in whole numbers, streamed against static.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::sync::Arc;

use clouds::{Place, Survey, cases, cloud, squared_distance, survey};
use oracle::partition::{canonical, components, refines};
use oracle::radius::{pairs_within, squared_length};
use proptest::prelude::*;
use streaming::{Run, static_labels, stream};
use streamseg::label::NONE;
use streamseg::lattice::Metric;
use streamseg::segmentor::{Dbscan, Graph, Proximity, Segmentor};
use streamseg::span::{Direction, Source, SpanBy};
use streamseg::window::WindowSize;

fn window_size() -> impl Strategy<Value = WindowSize> {
    (2usize..6).prop_flat_map(|spans| (Just(spans), 1..spans)).prop_map(|(s, o)| WindowSize::new(s, o).unwrap())
}

fn direction() -> impl Strategy<Value = Direction> {
    prop_oneof![2 => Just(Direction::X), 1 => Just(Direction::Y), 1 => (-360.0f64..360.0).prop_map(Direction::Azimuth)]
}

fn metric() -> impl Strategy<Value = Metric> {
    prop::sample::select(vec![Metric::Xyz, Metric::Xy])
}

fn axes(metric: Metric) -> usize {
    if metric == Metric::Xyz { 3 } else { 2 }
}

/// Spans of which the overlap holds `reach` units: exactly, where coordinates are exact, or with some to spare.
fn run(reach: f64, spare: i64, size: WindowSize, direction: Direction, threads: usize, survey: &Survey) -> Run {
    let width = reach / size.overlap() as f64;
    let is_exact = direction == Direction::X && survey.lattice.is_whole() && width.fract() == 0.0;
    let width = if is_exact { width } else { width * (1.0 + 1e-5) } + spare as f64;
    let by = SpanBy::Width { width: width * survey.unit, direction };
    Run { by, size, source: Source::Stored, chunks: vec![7, 100], threads }
}

/// DBSCAN as it is written, with our rule for border points.
fn dbscan(points: &[Place], squared: i64, min_points: usize, axes: usize) -> Vec<i64> {
    let near = |a: usize, b: usize| squared_length(points[a], points[b], axes) <= squared;
    let all = 0..points.len();
    let is_core: Vec<bool> = all.clone().map(|a| all.clone().filter(|&b| near(a, b)).count() >= min_points).collect();
    let pairs = pairs_within(points, squared, axes).into_iter().filter(|&(a, b)| is_core[a] && is_core[b]);
    let segments = components(points.len(), pairs);
    let nearest_core = |a: usize| {
        let cores = all.clone().filter(|&b| is_core[b] && near(a, b));
        cores.min_by_key(|&b| (squared_length(points[a], points[b], axes), b))
    };
    all.clone().map(|a| nearest_core(a).map_or(NONE, |core| segments[core])).collect()
}

proptest! {
    #![proptest_config(cases(192))]

    #[test]
    fn the_radius_graph_is_that_of_all_pairs_also_streamed(
        cloud in cloud(), survey in survey(), squared in squared_distance(), metric in metric(), size in window_size(),
        spare in prop::sample::select(vec![0i64, 1, 40]), direction in direction(), threads in 1usize..3,
    ) {
        let points = survey.told(&cloud);
        let distance = (squared as f64).sqrt();
        let segmentor = Proximity::new(distance * survey.unit, metric).unwrap().with_graph(Graph::Radius);
        let expected = components(cloud.len(), pairs_within(&survey.in_units(&cloud), squared, axes(metric)));
        prop_assert_eq!(canonical(&static_labels(&points, survey.lattice, &segmentor)), canonical(&expected));
        let run = run(distance, spare, size, direction, threads, &survey);
        prop_assert!(segmentor.exactness().assess(run.by, size, &survey.lattice).is_identical);
        let outcome = stream(&points, survey.lattice, Arc::new(segmentor), &run);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&expected));
    }

    #[test]
    fn dbscan_is_as_it_is_written(
        cloud in cloud(), survey in survey(), squared in squared_distance(), metric in metric(), min_points in 1usize..9,
    ) {
        // Rounded coordinates do not tell which of two core points is nearer if both are equally near.
        if !survey.lattice.is_whole() && survey.unit != 1.0 {
            return Ok(());
        }
        let segmentor = Dbscan::new((squared as f64).sqrt() * survey.unit, min_points, metric).unwrap();
        let labels = static_labels(&survey.told(&cloud), survey.lattice, &segmentor);
        let expected = dbscan(&survey.in_units(&cloud), squared, min_points, axes(metric));
        prop_assert_eq!(canonical(&labels), canonical(&expected));
    }

    #[test]
    fn dbscan_streamed_is_static_if_some_window_holds_what_each_point_depends_on(
        cloud in cloud(), survey in survey(), squared in squared_distance(), metric in metric(), min_points in 1usize..9,
        size in window_size(), spare in prop::sample::select(vec![0i64, 1, 40]), direction in direction(),
        threads in 1usize..3,
    ) {
        let points = survey.told(&cloud);
        let eps = (squared as f64).sqrt();
        let segmentor = Dbscan::new(eps * survey.unit, min_points, metric).unwrap();
        let expected = static_labels(&points, survey.lattice, &segmentor);
        // 2 · eps to either side of each point.
        let run = run(4.0 * eps, spare, size, direction, threads, &survey);
        let outcome = stream(&points, survey.lattice, Arc::new(segmentor), &run);
        prop_assert_eq!(canonical(&outcome.settled), canonical(&expected));
        prop_assert_eq!(&outcome.resolved_raw, &outcome.settled);
    }

    /// Narrower windows leave points out and segments apart, but join nothing wrongly.
    #[test]
    fn dbscan_streamed_never_joins_what_is_apart(
        cloud in cloud(), survey in survey(), squared in squared_distance(), metric in metric(), min_points in 1usize..9,
        size in window_size(), width in 1i64..20, direction in direction(),
    ) {
        let points = survey.told(&cloud);
        let segmentor = Dbscan::new((squared as f64).sqrt() * survey.unit, min_points, metric).unwrap();
        let whole = static_labels(&points, survey.lattice, &segmentor);
        let by = SpanBy::Width { width: width as f64 * survey.unit, direction };
        let run = Run { by, size, source: Source::Stored, chunks: vec![1000], threads: 1 };
        let streamed = stream(&points, survey.lattice, Arc::new(segmentor), &run).settled;
        let labelled = |ids: &[i64]| -> Vec<i64> {
            ids.iter().zip(&streamed).filter(|(_, streamed)| **streamed != NONE).map(|(&id, _)| id).collect()
        };
        prop_assert!(refines(&labelled(&streamed), &labelled(&whole)));
        prop_assert!(labelled(&whole).iter().all(|&id| id != NONE));
    }
}
