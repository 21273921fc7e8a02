//! Spans and windows that hold as much as there is room for: against a slow twin, and the partition against the static one.
//!
//! `PROPTEST_CASES` scales the number of clouds tried; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;
mod streaming;

use std::sync::{Arc, Mutex};

use clouds::{cases, cloud, survey};
use oracle::partition::canonical;
use proptest::prelude::*;
use streaming::{Run, chunks_of, static_labels, stream};
use streamseg::error::Result;
use streamseg::label::Labels;
use streamseg::lattice::{Lattice, Metric};
use streamseg::plan::{Budget, Census, Plan, windows};
use streamseg::segmentor::{Dbscan, Exactness, Graph, Proximity, Segmented, Segmentor};
use streamseg::span::{Direction, Source, SpanBy};
use streamseg::window::{Halo, Window, WindowSize};

/// Labels everything with one label, and writes down what windows it saw.
struct Witness {
    exactness: Exactness,
    halo: Halo,
    seen: Mutex<Vec<[usize; 3]>>,
}

impl Segmentor for Witness {
    fn name(&self) -> &'static str {
        "witness"
    }

    fn exactness(&self) -> Exactness {
        self.exactness
    }

    fn halo(&self) -> Halo {
        self.halo
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        self.seen.lock().unwrap().push([window.own_spans().len(), window.own().len(), window.len()]);
        Ok(Labels::from_any(&vec![0; window.points().len()]).into())
    }
}

fn window_size() -> impl Strategy<Value = WindowSize> {
    let spans = (2usize..5).prop_flat_map(|spans| (Just(spans), 1..spans));
    (spans, 0usize..120).prop_map(|((spans, overlap), room)| WindowSize::new(spans, overlap).unwrap().with_room(room))
}

/// In units of what `scaled` takes as one.
fn halo() -> impl Strategy<Value = Halo> {
    let length = || 0.2f64..3.0;
    prop_oneof![
        Just(Halo::None),
        length().prop_map(Halo::Length),
        Just(Halo::SpanBeyond(0.0)),
        length().prop_map(Halo::SpanBeyond),
    ]
}

fn scaled(halo: Halo, one: f64) -> Halo {
    match halo {
        Halo::None => Halo::None,
        Halo::Length(length) => Halo::Length(length * one),
        Halo::SpanBeyond(length) => Halo::SpanBeyond(length * one),
    }
}

fn run(by: SpanBy, size: WindowSize, threads: usize) -> Run {
    Run { by, size, source: Source::Stored, chunks: vec![7, 0, 3], threads }
}

/// What windows there should be, from the points' places along x in widths of a slab: own spans, own points, points loaded.
fn slow_twin(ways: &[f64], most: usize, size: WindowSize, halo: Halo) -> Vec<[usize; 3]> {
    let slab = |way: f64| way.floor() as i64;
    let mut numbers: Vec<i64> = ways.iter().map(|&way| slab(way)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let among = |slabs: &[i64]| ways.iter().filter(|&&way| slabs.contains(&slab(way))).count();
    let mut spans: Vec<Vec<i64>> = Vec::new();
    for &number in &numbers {
        match spans.last_mut() {
            Some(span) if among(&[&span[..], &[number]].concat()) <= most => span.push(number),
            _ => spans.push(vec![number]),
        }
    }
    let loaded = |first: usize, end: usize| {
        // Up to where the next span begins, all is known to be empty.
        let begins = |span: usize| spans[span][0] as f64;
        let ends = |span: usize| if span + 1 < spans.len() { begins(span + 1) } else { f64::INFINITY };
        let is_within = |span: usize, length: f64| {
            if span < first {
                ends(span) > begins(first) - length * (1.0 + 1e-6)
            } else {
                begins(span) < ends(end - 1) + length * (1.0 + 1e-6)
            }
        };
        let is_loaded = |span: usize| match halo {
            _ if (first..end).contains(&span) => true,
            Halo::None => false,
            Halo::Length(length) => is_within(span, length),
            Halo::SpanBeyond(length) => {
                is_within(span, length)
                    || if span < first {
                        span + 1 == first || is_within(span + 1, length)
                    } else {
                        span == end || is_within(span - 1, length)
                    }
            }
        };
        (0..spans.len()).filter(|&span| is_loaded(span)).map(|span| among(&spans[span])).sum::<usize>()
    };
    let mut windows = Vec::new();
    let mut first = 0;
    while first < spans.len() {
        let least = (first + size.spans()).min(spans.len());
        let fits = |end: &usize| loaded(first, *end) <= size.room().unwrap();
        let end = (least + 1..=spans.len()).take_while(fits).last().unwrap_or(least);
        windows.push([end - first, spans[first..end].iter().map(|span| among(span)).sum(), loaded(first, end)]);
        if end == spans.len() {
            break;
        }
        first = end - size.overlap();
    }
    windows
}

fn census(points: &[[f64; 3]], lattice: &Lattice, reach: f64) -> Census {
    let mut census = Census::new(reach, lattice);
    for chunk in &chunks_of(points, &[5, 11]) {
        census.add(chunk).unwrap();
    }
    census
}

proptest! {
    #![proptest_config(cases(400))]

    #[test]
    fn windows_hold_as_much_as_there_is_room_for(
        cloud in cloud(),
        survey in survey(),
        steps in 1i64..12,
        size in window_size(),
        most in 0usize..40,
        halo in halo(),
    ) {
        // Between the slabs' borders, so that no rounding decides where a point is.
        let points = survey.told(&cloud);
        let width = (steps as f64 + 0.25) * survey.unit;
        let reach = width;
        let exactness = Exactness::WithHalo { reach, halo: 0.0 };
        let witness = Arc::new(Witness { exactness, halo: scaled(halo, width), seen: Mutex::default() });
        let by = SpanBy::Slabs { width, direction: Direction::X, points: most };
        stream(&points, survey.lattice, witness.clone(), &run(by, size, 1));
        let seen = witness.seen.lock().unwrap().clone();
        let ways: Vec<f64> = points.iter().map(|point| survey.lattice.real(point)[0] / width).collect();
        prop_assert_eq!(&seen, &slow_twin(&ways, most, size, halo));
        for (window, next) in seen.iter().zip(seen.iter().skip(1).map(Some).chain([None])) {
            prop_assert!(window[2] <= size.room().unwrap() || window[0] <= size.spans(), "{:?} then {:?}", window, next);
        }
    }

    #[test]
    fn windows_are_those_that_were_planned(
        cloud in cloud(),
        survey in survey(),
        steps in 1i64..12,
        size in window_size(),
        most in 0u64..40,
        halo in halo(),
        along_y: bool,
    ) {
        let points = survey.told(&cloud);
        let reach = steps as f64 * survey.unit;
        let exactness = Exactness::WithHalo { reach, halo: 0.0 };
        let halo = scaled(halo, reach);
        let witness = Arc::new(Witness { exactness, halo, seen: Mutex::default() });
        let census = census(&points, &survey.lattice, reach);
        let counts = &census.counts()[usize::from(along_y)];
        let by = SpanBy::Slabs { width: counts.width(), direction: counts.direction(), points: most as usize };
        stream(&points, survey.lattice, witness.clone(), &run(by, size, 1));
        let planned: Vec<[usize; 3]> = windows(counts, most, size, halo)
            .iter()
            .map(|window| [window.spans, window.own as usize, window.loaded as usize])
            .collect();
        prop_assert_eq!(&*witness.seen.lock().unwrap(), &planned);
    }

    #[test]
    fn the_partition_is_the_static_one_whatever_the_room(
        cloud in cloud(),
        survey in survey(),
        squared in 1i64..180,
        size in window_size(),
        most in 0usize..40,
        along_y: bool,
        threads in 1usize..4,
    ) {
        let points = survey.told(&cloud);
        let distance = (squared as f64).sqrt() * survey.unit;
        let segmentors: [Arc<dyn Segmentor>; 4] = [
            Arc::new(Proximity::new(distance, Metric::Xyz).unwrap()),
            Arc::new(Proximity::new(distance, Metric::Xy).unwrap()),
            Arc::new(Proximity::new(distance, Metric::Xyz).unwrap().with_graph(Graph::Radius)),
            Arc::new(Dbscan::new(distance, 4, Metric::Xyz).unwrap()),
        ];
        for segmentor in segmentors {
            let census = census(&points, &survey.lattice, segmentor.exactness().reach());
            let counts = &census.counts()[usize::from(along_y)];
            let by = SpanBy::Slabs { width: counts.width(), direction: counts.direction(), points: most };
            prop_assert!(segmentor.exactness().assess(by, size, &survey.lattice).is_identical);
            let expected = canonical(&static_labels(&points, survey.lattice, &*segmentor));
            let outcome = stream(&points, survey.lattice, segmentor.clone(), &run(by, size, threads));
            prop_assert_eq!(&canonical(&outcome.settled), &expected, "{}", segmentor.name());
            let alone = stream(&points, survey.lattice, segmentor, &run(by, size, 1));
            prop_assert_eq!(alone, outcome);
        }
    }
}

fn lattice() -> Lattice {
    Lattice::new([0.01; 3], [0.0; 3]).unwrap()
}

/// A cloud along x, ten times as dense in its middle as at its ends.
fn street(reach: f64) -> Census {
    let mut census = Census::new(reach, &lattice());
    let points = 2_000_000;
    let along = |i: usize| {
        let t = i as f64 / points as f64;
        if t < 0.1 {
            t * 4_500.0
        } else if t < 0.9 {
            450.0 + (t - 0.1) * 125.0
        } else {
            550.0 + (t - 0.9) * 4_500.0
        }
    };
    let points: Vec<[f64; 3]> =
        (0..points).map(|i| [(along(i) * 100.0).floor(), (i * 7919 % 3000) as f64, 0.0]).collect();
    census.add(&streaming::chunk(&points)).unwrap();
    census
}

#[test]
fn windows_are_long_where_the_cloud_is_thin_and_keep_to_the_budget() {
    let segmentor = Proximity::new(1.0, Metric::Xyz).unwrap();
    let census = street(1.0);
    for megabytes in [150, 200, 256, 1000] {
        let plan = Plan::new(&census, &segmentor, Budget::new(megabytes * 1_000_000).unwrap(), false).unwrap();
        assert_eq!(plan.direction(), Direction::X);
        assert_eq!(plan.warning(), None);
        assert!(plan.windows().iter().all(|window| window.loaded <= plan.room() as u64));
        for threads in [1, 2, 64] {
            assert!(plan.peak(threads) <= megabytes * 1_000_000, "{megabytes} {}", plan.peak(threads));
        }
        let longest = plan.windows().iter().map(|window| window.length).fold(0.0, f64::max);
        let shortest = plan.windows()[1..plan.windows().len() - 1].iter().map(|w| w.length).fold(f64::MAX, f64::min);
        assert!(longest > 5.0 * shortest, "{longest} {shortest}");
    }
}

#[test]
fn a_budget_that_is_too_small_is_told_with_what_would_do() {
    let segmentor = Proximity::new(25.0, Metric::Xyz).unwrap();
    let census = street(25.0);
    let plan = |bytes| Plan::new(&census, &segmentor, Budget::new(bytes).unwrap(), false).unwrap();
    let warning = plan(150_000_000).warning().unwrap();
    let (needed, _) = warning.split_once(" MB, some of it in reserve, more than the max_memory of 150 MB").unwrap();
    let needed: u64 = needed.rsplit(' ').next().unwrap().parse().unwrap();
    assert_eq!(plan(needed * 1_000_000).warning(), None);
    assert!(plan((needed - 2) * 1_000_000).warning().is_some());
}

#[test]
fn an_empty_cloud_has_a_plan_too() {
    let census = Census::new(1.0, &lattice());
    let segmentor = Proximity::new(1.0, Metric::Xyz).unwrap();
    let plan = Plan::new(&census, &segmentor, Budget::default(), false).unwrap();
    assert!(plan.windows().is_empty() && plan.warning().is_none());
    assert!(plan.explain(2).iter().any(|(label, _)| *label == "windows"));
}
