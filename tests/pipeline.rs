//! The pipeline as an iterator: how much it asks of its source, how it stops, and what it says of failures.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod streaming;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use streaming::point_ids;
use streamseg::crew::Crew;
use streamseg::error::{Error, Result};
use streamseg::label::{Labels, NONE};
use streamseg::lattice::{Lattice, Metric};
use streamseg::pipeline::{Allowance, Outgoing, Pipeline};
use streamseg::segmentor::{Exactness, Proximity, Segmented, Segmentor};
use streamseg::span::{Chunk, Direction, Invalid, Source, SpanBy, checked, spans_of};
use streamseg::window::{Window, WindowSize};

const POINTS_PER_SPAN: usize = 4;

/// The points of one span of an endless row, one step apart.
fn span_of_row(span: usize) -> Chunk {
    let first = span * POINTS_PER_SPAN;
    let points = (first..first + POINTS_PER_SPAN).map(|x| [x as f64, 0.0, 0.0]).collect();
    Chunk { points, attributes: vec![] }
}

/// A row without end that counts how many of its spans were asked for.
fn counted_row() -> (impl Iterator<Item = Result<Chunk>> + Send + 'static, Arc<AtomicUsize>) {
    let asked = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&asked);
    let row = (0..).map(move |span| {
        counter.fetch_add(1, Ordering::Relaxed);
        Ok(span_of_row(span))
    });
    (row, asked)
}

fn some_failure(what: &str) -> Error {
    Error::Foreign(what.into())
}

fn streaming(
    chunks: impl Iterator<Item = Result<Chunk>> + Send + 'static,
    segmentor: impl Segmentor + 'static,
    size: WindowSize,
    threads: usize,
) -> Pipeline {
    let spans = spans_of(chunks, SpanBy::Given, &Lattice::REAL, Source::Live).unwrap();
    Pipeline::new(spans, Lattice::REAL, Arc::new(segmentor), size, Crew::new(threads).unwrap())
}

fn steps_joined() -> Proximity {
    Proximity::new(1.0, Metric::Xyz).unwrap()
}

/// All points in one segment, but for window `window`, of which it says something else.
struct Says<F>(u64, F);

impl<F: Fn(&Window) -> Result<Labels> + Send + Sync> Segmentor for Says<F> {
    fn name(&self) -> &'static str {
        "says"
    }

    fn exactness(&self) -> Exactness {
        Exactness::Measured { reach: 0.0, halo: 0.0 }
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let all_in_one = |window: &Window| Ok(Labels::from_any(&vec![0; window.points().len()]));
        let labels = if window.index() == self.0 { self.1(window) } else { all_in_one(window) };
        Ok(labels?.into())
    }
}

/// Point ids that came out, and the failures between and behind them.
fn all_of(pipeline: &mut Pipeline) -> (Vec<i64>, Vec<Error>) {
    let (mut points, mut failures) = (Vec::new(), Vec::new());
    for out in pipeline.by_ref() {
        match out {
            Ok(Outgoing { span, segmented, .. }) => {
                assert!(failures.is_empty(), "failures come last");
                assert_eq!((segmented.index, segmented.raw_ids.len()), (span.index, span.len()));
                points.extend(point_ids(&span));
            }
            Err(error) => failures.push(error),
        }
    }
    assert!(pipeline.next().is_none(), "an exhausted pipeline stays so");
    (points, failures)
}

fn first(points: usize) -> Vec<i64> {
    (0..points as i64).collect()
}

#[test]
fn one_thread_asks_for_no_span_before_it_is_needed() {
    for (spans, overlap) in [(1, 0), (2, 1), (3, 0), (3, 1), (3, 2), (6, 1)] {
        let size = WindowSize::new(spans, overlap).unwrap();
        let (row, asked) = counted_row();
        let mut pipeline = streaming(row, steps_joined(), size, 1);
        assert_eq!(asked.load(Ordering::Relaxed), 0, "nothing is asked for before the first span is");
        for index in 0..20 {
            let out = pipeline.next().unwrap().unwrap();
            assert_eq!(out.span.index, index);
            // A span leaves when a window is woven whose predecessor does not hold it.
            let last_window_with = index as usize / size.advance();
            let needed = (last_window_with + 2) * size.advance() + size.spans();
            assert_eq!(asked.load(Ordering::Relaxed), needed, "span {index} of windows {spans}/{overlap}");
        }
    }
}

#[test]
fn each_further_thread_reads_one_window_ahead() {
    let size = WindowSize::default();
    for threads in [2, 4] {
        let (row, asked) = counted_row();
        let mut pipeline = streaming(row, steps_joined(), size, threads);
        pipeline.next().unwrap().unwrap();
        let needed = 2 * size.advance() + size.spans();
        assert!(asked.load(Ordering::Relaxed) <= needed + (threads - 1) * size.advance());
    }
}

/// How many windows are begun, how often the pipeline has looked up, and how many were begun when the first was done.
#[derive(Clone, Default)]
struct Windows {
    begun: Arc<AtomicUsize>,
    looks: Arc<AtomicUsize>,
    most: Arc<AtomicUsize>,
}

/// The first window takes until the pipeline has looked up often enough to have begun as many as there are threads.
impl Segmentor for Windows {
    fn name(&self) -> &'static str {
        "windows"
    }

    fn exactness(&self) -> Exactness {
        Exactness::Measured { reach: 0.0, halo: 0.0 }
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        self.begun.fetch_add(1, Ordering::SeqCst);
        if window.index() == 0 {
            while self.looks.load(Ordering::SeqCst) < 12 {
                std::thread::yield_now();
            }
            self.most.fetch_max(self.begun.load(Ordering::SeqCst), Ordering::SeqCst);
        }
        Ok(Labels::from_any(&vec![0; window.points().len()]).into())
    }
}

/// Whatever the scheduler does: windows that are done, but wait for one before them, have not been given back yet.
#[test]
fn what_is_in_flight_is_counted_before_it_is_taken() {
    let size = WindowSize::new(1, 0).unwrap();
    let points = POINTS_PER_SPAN as u64;
    for (allowed, expected) in [(0, 1), (points, 1), (2 * points, 2), (3 * points - 1, 2), (3 * points, 3), (99, 4)] {
        let windows = Windows::default();
        let (looks, most) = (Arc::clone(&windows.looks), Arc::clone(&windows.most));
        let asked = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&asked);
        let chunks = (0..9).map(move |span| {
            counter.fetch_add(1, Ordering::SeqCst);
            Ok(span_of_row(span))
        });
        let (during, while_held) = (Arc::new(AtomicUsize::new(0)), Arc::clone(&asked));
        let seen = Arc::clone(&during);
        let mut pipeline = streaming(chunks, windows.clone(), size, 4)
            .with_allowance(Allowance::new(allowed * 50, 50))
            .with_look_up(move |progress| {
                if progress.windows == 0 {
                    seen.store(while_held.load(Ordering::SeqCst), Ordering::SeqCst);
                }
                looks.fetch_add(1, Ordering::SeqCst);
                Ok(())
            });
        assert_eq!(all_of(&mut pipeline).0, first(9 * POINTS_PER_SPAN));
        assert!(most.load(Ordering::SeqCst) <= expected, "{allowed} allowed");
        // A window that is not taken yet waits as its span, and nothing is read beyond it.
        let read = during.load(Ordering::SeqCst);
        assert_eq!(read, if expected == 4 { 4 } else { expected + 1 }, "{allowed} allowed");
    }
}

#[test]
fn an_endless_source_is_stopped_and_every_point_taken_comes_out() {
    for threads in [1, 2] {
        for taken in [0, 1, 5, 8] {
            let (row, asked) = counted_row();
            let mut pipeline = streaming(row, steps_joined(), WindowSize::default(), threads);
            let mut points: Vec<i64> = Vec::new();
            for out in pipeline.by_ref().take(taken) {
                points.extend(point_ids(&out.unwrap().span));
            }
            pipeline.stop();
            let (rest, failures) = all_of(&mut pipeline);
            points.extend(rest);
            assert!(failures.is_empty());
            assert_eq!(points, first(asked.load(Ordering::Relaxed) * POINTS_PER_SPAN), "{taken} taken");
            assert_eq!(pipeline.progress().points as usize, points.len());
        }
    }
}

#[test]
fn a_source_that_fails_costs_no_span_and_is_told_at_the_end() {
    for threads in [1, 2, 4] {
        for spans in 0..9 {
            let chunks = (0..spans).map(|span| Ok(span_of_row(span)));
            let chunks = chunks.chain([Err(some_failure("the cable is loose"))]);
            let (points, failures) = all_of(&mut streaming(chunks, steps_joined(), WindowSize::default(), threads));
            assert_eq!(points, first(spans * POINTS_PER_SPAN), "failure after {spans} spans, {threads} threads");
            assert_eq!(failures.len(), 1, "failure after {spans} spans, {threads} threads");
            assert_eq!(failures[0].to_string(), "the cable is loose");
        }
    }
}

/// Which points a slab holds is known only when all have come, so slabs of a part of the cloud would be wrong.
#[test]
fn a_stored_source_that_fails_hands_out_no_half_slabs() {
    let chunks = [Ok(span_of_row(0)), Ok(span_of_row(1)), Err(some_failure("the disk is full"))];
    let by = SpanBy::Width { width: 3.0, direction: Direction::X };
    let spans = spans_of(chunks.into_iter(), by, &Lattice::REAL, Source::Stored).unwrap();
    let (size, crew) = (WindowSize::default(), Crew::new(1).unwrap());
    let (points, failures) = all_of(&mut Pipeline::new(spans, Lattice::REAL, Arc::new(steps_joined()), size, crew));
    assert!(points.is_empty());
    assert_eq!(failures.len(), 1);
    assert_eq!(failures[0].to_string(), "the disk is full");
}

#[test]
fn a_segmentor_that_fails_ends_the_stream_after_what_was_woven() {
    for threads in [1, 2] {
        for window in 0..4 {
            let (row, _) = counted_row();
            let fails = Says(window, |_: &Window| Err(some_failure("no labels today")));
            let mut pipeline = streaming(row, fails, WindowSize::default(), threads);
            let (points, failures) = all_of(&mut pipeline);
            let spans = if window == 0 { 0 } else { 3 + 2 * (window as usize - 1) };
            assert_eq!(points, first(spans * POINTS_PER_SPAN), "window {window}, {threads} threads");
            assert_eq!(failures.len(), 1, "window {window}, {threads} threads");
            assert_eq!(failures[0].to_string(), "no labels today");
        }
    }
}

#[test]
fn a_segmentor_that_panics_is_named_with_the_window() {
    for threads in [1, 2] {
        let (row, _) = counted_row();
        let panics = Says(2, |_: &Window| panic!("this panic is part of the test"));
        let (points, failures) = all_of(&mut streaming(row, panics, WindowSize::default(), threads));
        assert_eq!(points, first(5 * POINTS_PER_SPAN));
        assert_eq!(failures.len(), 1);
        let told = matches!(&failures[0], Error::Panicked { segmentor, window: 2, message }
            if segmentor == "says" && message.contains("part of the test"));
        assert!(told, "{}", failures[0]);
    }
}

#[test]
fn labels_that_are_too_few_or_too_many_are_refused() {
    for too in [-1i64, 1] {
        let (row, _) = counted_row();
        let wrong =
            move |window: &Window| Ok(Labels::from_any(&vec![0; (window.points().len() as i64 + too) as usize]));
        let (points, failures) = all_of(&mut streaming(row, Says(1, wrong), WindowSize::default(), 1));
        assert_eq!(points, first(3 * POINTS_PER_SPAN));
        assert!(matches!(&failures[..], [Error::Labels { .. }]), "{failures:?}");
    }
}

#[test]
fn an_interrupted_run_goes_on_and_loses_nothing() {
    for threads in [1, 2] {
        let chunks = (0..9).map(|span| Ok(span_of_row(span)));
        let mut calls = 0;
        let mut pipeline = streaming(chunks, steps_joined(), WindowSize::default(), threads).with_look_up(move |_| {
            calls += 1;
            if calls % 2 == 0 { Err(some_failure("interrupted")) } else { Ok(()) }
        });
        let (mut points, mut interrupts) = (Vec::new(), 0);
        for out in pipeline.by_ref() {
            match out {
                Ok(out) => {
                    assert!(out.segmented.carried_ids.iter().all(|&id| id == 1));
                    points.extend(point_ids(&out.span));
                }
                Err(error) => {
                    assert_eq!(error.to_string(), "interrupted");
                    interrupts += 1;
                }
            }
        }
        assert_eq!(points, first(9 * POINTS_PER_SPAN));
        assert!(interrupts > 9);
    }
}

#[test]
fn a_long_wait_for_a_window_is_interrupted_and_taken_up_again() {
    let let_go = Arc::new(AtomicBool::new(false));
    let is_let_go = Arc::clone(&let_go);
    let slow = Says(0, move |window: &Window| {
        while !is_let_go.load(Ordering::Relaxed) {
            std::thread::yield_now();
        }
        Ok(Labels::from_any(&vec![0; window.points().len()]))
    });
    let chunks = (0..3).map(|span| Ok(span_of_row(span)));
    let waiting = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&waiting);
    // Three spans and the end of the source come before the wait, so the sixth call comes during it.
    let mut calls = 0;
    let mut pipeline = streaming(chunks, slow, WindowSize::default(), 2).with_look_up(move |_| {
        calls += 1;
        let interrupt = calls == 6;
        seen.fetch_or(interrupt, Ordering::Relaxed);
        if interrupt { Err(some_failure("interrupted")) } else { Ok(()) }
    });
    // A wait that did not end would have no end: the window is done only afterwards.
    assert!(pipeline.next().unwrap().is_err());
    assert!(waiting.load(Ordering::Relaxed));
    let_go.store(true, Ordering::Relaxed);
    assert_eq!(all_of(&mut pipeline).0, first(3 * POINTS_PER_SPAN));
}

fn row_with_an_invalid_point() -> Vec<Result<Chunk>> {
    let mut chunks: Vec<Chunk> = (0..6).map(span_of_row).collect();
    chunks[3].points[1][2] = f64::NAN;
    chunks.into_iter().map(Ok).collect()
}

#[test]
fn invalid_points_that_are_dropped_come_out_without_a_segment() {
    let chunks = checked(row_with_an_invalid_point(), Invalid::Drop);
    let mut ids = Vec::new();
    for out in streaming(chunks, Proximity::new(2.0, Metric::Xyz).unwrap(), WindowSize::default(), 1) {
        ids.extend(out.unwrap().segmented.carried_ids);
    }
    let expected: Vec<i64> = (0..24).map(|point| if point == 13 { NONE } else { 1 }).collect();
    assert_eq!(ids, expected);
}

#[test]
fn the_first_invalid_point_is_named_when_such_are_rejected() {
    let chunks = checked(row_with_an_invalid_point(), Invalid::Reject);
    let (points, failures) = all_of(&mut streaming(chunks, steps_joined(), WindowSize::default(), 1));
    assert_eq!(points, first(13));
    assert!(matches!(&failures[..], [Error::NotFinite { point_id: 13, .. }]), "{failures:?}");
}

#[test]
fn spans_without_points_and_without_labels_pass_through() {
    let chunks = [0, 1, 0, 0, 0, 0, 0, 2]
        .map(|points| Ok(Chunk { points: vec![[f64::from(points), 0.0, 0.0]; points as usize], attributes: vec![] }));
    let none = Says(1, |window: &Window| Ok(Labels::from_any(&vec![NONE; window.points().len()])));
    let mut pipeline = streaming(chunks.into_iter(), none, WindowSize::default(), 1);
    let (mut points, mut windows) = (0, Vec::new());
    for out in pipeline.by_ref().map(Result::unwrap) {
        points += out.span.len();
        windows.extend(out.windows.iter().map(|window| window.spans));
    }
    assert_eq!((points, windows), (3, vec![3, 3, 3, 2]));
}

#[test]
fn an_empty_source_ends_at_once() {
    for by in [SpanBy::Given, SpanBy::Count { points: 5 }] {
        let spans = spans_of(std::iter::empty(), by, &Lattice::REAL, Source::Live).unwrap();
        let crew = Crew::new(2).unwrap();
        let mut pipeline = Pipeline::new(spans, Lattice::REAL, Arc::new(steps_joined()), WindowSize::default(), crew);
        assert!(pipeline.next().is_none() && pipeline.next().is_none());
    }
}

/// What a source delivered comes out, also when it is stopped in the middle of a span or of a chunk.
#[test]
fn a_stopped_stream_loses_nothing_that_had_come() {
    for by in [SpanBy::Count { points: 25 }, SpanBy::Width { width: 7.0, direction: Direction::X }] {
        let delivered = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&delivered);
        let chunks = (0..).map(move |chunk| {
            counter.fetch_add(10, Ordering::Relaxed);
            let points = (0..10).map(|i| [f64::from(chunk * 10 + i), 0.0, 0.0]).collect();
            Ok(Chunk { points, attributes: vec![] })
        });
        let spans = spans_of(chunks, by, &Lattice::REAL, Source::Live).unwrap();
        let crew = Crew::new(1).unwrap();
        let mut pipeline = Pipeline::new(spans, Lattice::REAL, Arc::new(steps_joined()), WindowSize::default(), crew);
        let mut points = pipeline.next().unwrap().unwrap().span.len();
        pipeline.stop();
        points += pipeline.map(|out| out.unwrap().span.len()).sum::<usize>();
        assert_eq!(points, delivered.load(Ordering::Relaxed));
    }
}

/// Whose patience has ended gets what has been woven, not what is under way.
#[test]
fn a_window_that_takes_too_long_is_given_up() {
    struct Slow(Arc<AtomicBool>);
    impl Segmentor for Slow {
        fn name(&self) -> &'static str {
            "slow"
        }
        fn exactness(&self) -> Exactness {
            Exactness::Measured { reach: 0.0, halo: 0.0 }
        }
        fn segment(&self, window: &Window) -> Result<Segmented> {
            while window.index() == 3 && !self.0.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            Ok(Labels::from_any(&vec![0; window.points().len()]).into())
        }
    }
    for threads in [1, 2] {
        let over = Arc::new(AtomicBool::new(false));
        let (row, _) = counted_row();
        let mut pipeline = streaming(row, Slow(Arc::clone(&over)), WindowSize::default(), threads);
        pipeline.stop_within(Duration::from_secs(1000));
        assert!(pipeline.next().is_none());

        let (row, _) = counted_row();
        let interrupts = Arc::new(AtomicBool::new(false));
        let interrupt = Arc::clone(&interrupts);
        let pipeline = streaming(row, Slow(Arc::clone(&over)), WindowSize::default(), threads);
        let mut pipeline = pipeline.with_look_up(move |progress| {
            let is_waiting = progress.windows == 3 && !interrupt.swap(true, Ordering::Relaxed);
            if is_waiting { Err(some_failure("interrupted")) } else { Ok(()) }
        });
        let taken = pipeline.by_ref().take_while(std::result::Result::is_ok).count();
        pipeline.stop_within(Duration::ZERO);
        let left: Vec<Outgoing> = pipeline.map(Result::unwrap).collect();
        // Windows 0 to 2 are spans 0 to 6.
        assert_eq!(taken + left.len(), 7);
        assert!(interrupts.load(Ordering::Relaxed));
        over.store(true, Ordering::Relaxed);
    }
}

/// A segmentor that keeps state is asked for one window after the other, whatever the number of threads.
#[test]
fn a_segmentor_that_is_not_concurrent_is_called_one_at_a_time() {
    struct Stateful(AtomicUsize, AtomicUsize);
    impl Segmentor for Stateful {
        fn name(&self) -> &'static str {
            "stateful"
        }
        fn exactness(&self) -> Exactness {
            Exactness::Measured { reach: 0.0, halo: 0.0 }
        }
        fn is_concurrent(&self) -> bool {
            false
        }
        fn segment(&self, window: &Window) -> Result<Segmented> {
            assert_eq!(self.0.fetch_add(1, Ordering::SeqCst), 0, "two windows at the same time");
            std::thread::sleep(std::time::Duration::from_millis(5));
            assert_eq!(self.1.fetch_add(1, Ordering::SeqCst), window.index() as usize, "out of order");
            self.0.fetch_sub(1, Ordering::SeqCst);
            Ok(Labels::from_any(&vec![0; window.points().len()]).into())
        }
    }
    let chunks = (0..40).map(|i| Ok(Chunk { points: vec![[f64::from(i), 0.0, 0.0]; 3], attributes: vec![] }));
    let spans = spans_of(chunks, SpanBy::Given, &Lattice::REAL, Source::Live).unwrap();
    let segmentor = Arc::new(Stateful(AtomicUsize::new(0), AtomicUsize::new(0)));
    let pipeline = Pipeline::new(spans, Lattice::REAL, segmentor, WindowSize::default(), Crew::new(4).unwrap());
    assert_eq!(pipeline.map(|out| out.unwrap().span.len()).sum::<usize>(), 120);
}
