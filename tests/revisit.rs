//! Streams that come back: in any order of spans, live or stored, relations that only join more give the static partition.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::sync::Arc;

use clouds::{cases, cloud, squared_distance, survey};
use oracle::partition::{canonical, components, refines};
use oracle::radius::pairs_within;
use proptest::prelude::*;
use streaming::{Outcome, Run, outcome, pipeline, pipeline_with, static_labels_with, stream};
use streamseg::error::Error;
use streamseg::expression::Criterion;
use streamseg::label::Labels;
use streamseg::lattice::{Lattice, Metric};
use streamseg::neighborhood::Search;
use streamseg::revisit::Revisit;
use streamseg::segmentor::{ConditionalClustering, Dbscan, Exactness, Graph, Plane, Proximity, Segmented, Segmentor};
use streamseg::span::{Direction, Source, SpanBy};
use streamseg::window::{Window, WindowSize};

/// Windows that may share nothing, so that all joins have to come from what was brought back.
fn window_size() -> impl Strategy<Value = WindowSize> {
    (1usize..5).prop_flat_map(|spans| (Just(spans), 0..spans)).prop_map(|(s, o)| WindowSize::new(s, o).unwrap())
}

/// Clouds come in any order, so spans of a few points each lie all over the place.
fn run() -> impl Strategy<Value = Run> {
    let by = prop_oneof![
        3 => (1usize..30).prop_map(|points| SpanBy::Count { points }),
        3 => Just(SpanBy::Given),
        1 => (1i64..30).prop_map(|width| SpanBy::Width { width: width as f64 / 10.0, direction: Direction::Y }),
    ];
    let chunks = prop::collection::vec(1usize..40, 1..5);
    (by, window_size(), chunks, 1usize..4).prop_map(|(by, size, chunks, threads)| {
        let source = if matches!(by, SpanBy::Width { .. }) { Source::Stored } else { Source::Live };
        Run { by, size, source, chunks, threads }
    })
}

fn come_back(
    points: &[[f64; 3]],
    attributes: &[Vec<f64>],
    lattice: Lattice,
    segmentor: &Arc<dyn Segmentor>,
    run: &Run,
    room: usize,
) -> Outcome {
    let revisit = Revisit::new(segmentor.exactness(), lattice).unwrap().with_room(room);
    let pipeline = pipeline_with(points, attributes, lattice, Arc::clone(segmentor), run).with_revisit(revisit);
    outcome(pipeline, points.len())
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn in_any_order_of_spans_the_partition_is_the_static_one(
        cloud in cloud(), survey in survey(), squared in squared_distance(), run in run(),
        (graph, metric) in prop::sample::select(vec![
            (Graph::Radius, Metric::Xyz), (Graph::Radius, Metric::Xy), (Graph::Delaunay, Metric::Xy),
        ]),
        room in prop::sample::select(vec![1usize, 10, 1 << 16]),
    ) {
        let points = survey.told(&cloud);
        let distance = (squared as f64).sqrt() * survey.unit;
        let segmentor: Arc<dyn Segmentor> = Arc::new(Proximity::new(distance, metric).unwrap().with_graph(graph));
        let axes = if metric == Metric::Xyz { 3 } else { 2 };
        let expected = components(cloud.len(), pairs_within(&survey.in_units(&cloud), squared, axes));

        let told = come_back(&points, &[], survey.lattice, &segmentor, &run, room);
        prop_assert_eq!(canonical(&told.settled), canonical(&expected));
        prop_assert_eq!(&told.resolved_raw, &told.settled);
        prop_assert_eq!(&told.resolved_carried, &told.settled);
        prop_assert_eq!(&told.with_aliases, &told.settled);
        let by_rows = told.rows.iter().filter(|row| row.next_segment_id >= 0);
        let by_rows = by_rows.map(|row| (row.segment_id as usize, row.next_segment_id as usize));
        let last = told.raw.iter().copied().max().unwrap_or(0).max(told.rows.iter().map(|row| row.segment_id).max().unwrap_or(0));
        let whole = components(last as usize + 1, by_rows);
        let of_points: Vec<i64> = told.raw.iter().map(|&id| whole[id as usize]).collect();
        prop_assert_eq!(canonical(&of_points), canonical(&expected), "the history tells the same");
        let alone = come_back(&points, &[], survey.lattice, &segmentor, &Run { threads: 1, ..run.clone() }, room);
        prop_assert_eq!(alone, told, "whatever the number of threads");

        let without = stream(&points, survey.lattice, segmentor, &run);
        prop_assert!(refines(&without.settled, &expected));
    }

    #[test]
    fn criteria_over_given_attributes_get_them_back(
        cloud in cloud(), survey in survey(), squared in squared_distance(), run in run(),
        values in prop::collection::vec(0u8..5, 200),
    ) {
        let points = survey.told(&cloud);
        let attributes = [(0..cloud.len()).map(|i| f64::from(values[i % values.len()])).collect::<Vec<f64>>()];
        let criterion = Criterion::parse("abs(Intensity - n[0].Intensity) < 2").unwrap();
        let search = Search::Ball { radius: (squared as f64).sqrt() * survey.unit };
        let segmentor: Arc<dyn Segmentor> = Arc::new(ConditionalClustering::new(criterion, search));
        prop_assert!(segmentor.exactness().is_monotone());
        let expected = static_labels_with(&points, &attributes, survey.lattice, &*segmentor);
        let told = come_back(&points, &attributes, survey.lattice, &segmentor, &run, 10);
        prop_assert_eq!(canonical(&told.settled), canonical(&expected));
    }

    /// Where a later point can undo a decision nothing is promised, but nothing is lost, and every decision is counted.
    #[test]
    fn other_relations_run_and_count_what_was_decided_early(
        cloud in cloud(), survey in survey(), squared in squared_distance(), run in run(), min_points in 1usize..6,
    ) {
        let points = survey.told(&cloud);
        let dbscan = Dbscan::new((squared as f64).sqrt() * survey.unit, min_points, Metric::Xyz).unwrap();
        let revisit = Revisit::new(dbscan.exactness(), survey.lattice).unwrap();
        let mut pipeline = pipeline(&points, survey.lattice, Arc::new(dbscan), &run).with_revisit(revisit);
        let came_out: usize = pipeline.by_ref().map(|out| out.unwrap().span.len()).sum();
        prop_assert_eq!(came_out, points.len());
        let (early, windows) = (pipeline.certificate().early_decisions, pipeline.progress().windows);
        if matches!(run.by, SpanBy::Width { .. }) || windows <= 1 {
            prop_assert_eq!(early, 0);
        } else {
            // That a point is noise is a decision too.
            prop_assert!(early >= points.len() as u64);
        }
    }
}

/// Two passes over the same ground, one behind the other.
fn two_passes() -> Vec<[f64; 3]> {
    let pass = |shift: f64| (0..300).map(move |i| [f64::from(i), shift, 0.0]);
    pass(0.0).chain(pass(0.5)).collect()
}

#[test]
fn the_second_pass_is_another_segment_only_without_revisit() {
    let segmentor: Arc<dyn Segmentor> = Arc::new(Proximity::new(1.0, Metric::Xy).unwrap());
    let (by, size) = (SpanBy::Count { points: 10 }, WindowSize::default());
    let run = Run { by, size, source: Source::Live, chunks: vec![7], threads: 2 };
    let points = two_passes();
    let first = |outcome: &Outcome| (outcome.settled[0], outcome.settled[599]);
    let back = come_back(&points, &[], Lattice::REAL, &segmentor, &run, 1 << 16);
    assert_eq!(first(&back), (1, 1));
    // The same along a chain that is broken until the second pass closes it.
    let gaps: Vec<[f64; 3]> = points.iter().enumerate().filter(|(i, _)| i % 47 != 3).map(|(_, p)| *p).collect();
    let back = come_back(&gaps, &[], Lattice::REAL, &segmentor, &run, 1);
    assert!(back.settled.iter().all(|&id| id == 1));
    let without = stream(&gaps, Lattice::REAL, segmentor, &run);
    assert!(canonical(&without.settled).into_iter().max() > Some(2));
}

#[test]
fn returned_points_are_counted_and_only_those_within_reach() {
    let segmentor = Arc::new(Proximity::new(1.0, Metric::Xyz).unwrap().with_graph(Graph::Radius));
    let (by, size) = (SpanBy::Count { points: 10 }, WindowSize::default());
    let run = Run { by, size, source: Source::Live, chunks: vec![100], threads: 1 };
    let revisit = Revisit::new(segmentor.exactness(), Lattice::REAL).unwrap();
    let mut back = pipeline(&two_passes(), Lattice::REAL, segmentor, &run).with_revisit(revisit);
    back.by_ref().for_each(|out| drop(out.unwrap()));
    let certificate = back.certificate();
    // Each new point of the second pass has one below it; the others lie at the ends of windows.
    assert!((300..1000).contains(&certificate.returned_points), "{certificate:?}");
    assert!(certificate.is_complete());
}

/// Takes all points of a window for one level, at the height of the last.
struct Level;

impl Segmentor for Level {
    fn name(&self) -> &'static str {
        "level"
    }

    fn exactness(&self) -> Exactness {
        Exactness::Measured { reach: 1.0, halo: 0.0 }
    }

    fn segment(&self, window: &Window) -> Result<Segmented, Error> {
        let center = window.points().last().copied().unwrap_or_default();
        let level = Plane { center, normal: [0.0, 0.0, 1.0], sigma0: 0.0, points: 1, covariance: [0.0; 6] };
        let labels = Labels::from_any(&vec![0; window.points().len()]);
        Ok(Segmented { planes: Some(vec![level]), ..labels.into() })
    }

    fn agree(&self, a: &Plane, b: &Plane) -> bool {
        (a.center[2] - b.center[2]).abs() < 1.0
    }
}

#[test]
fn segments_with_planes_come_back_only_if_their_planes_agree() {
    let far = (1..6).map(|i| [10.0 * f64::from(i), 0.0, 0.0]);
    let points: Vec<[f64; 3]> =
        [[0.0; 3]].into_iter().chain(far).chain([[0.0, 0.0, 5.0], [0.0, 0.0, 0.5], [0.0, 0.0, 5.5]]).collect();
    let size = WindowSize::new(1, 0).unwrap();
    let run = Run { by: SpanBy::Count { points: 1 }, size, source: Source::Live, chunks: vec![100], threads: 1 };
    let segmentor: Arc<dyn Segmentor> = Arc::new(Level);
    let back = come_back(&points, &[], Lattice::REAL, &segmentor, &run, 1);
    assert_eq!(back.settled, [1, 2, 3, 4, 5, 6, 7, 1, 7]);
}

#[test]
fn without_a_reach_there_is_nothing_to_go_by() {
    let unknown = Exactness::Measured { reach: 0.0, halo: 0.0 };
    let unlimited = Exactness::WithHalo { reach: f64::INFINITY, halo: f64::INFINITY };
    for exactness in [unknown, unlimited] {
        let told = Revisit::new(exactness, Lattice::REAL).err().unwrap().to_string();
        assert!(told.starts_with("revisit is true with a segmentor whose reach is not known, allowed: "), "{told}");
    }
}
