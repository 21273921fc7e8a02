//! Labels per second of the weaver alone: labels are made beforehand and woven over and over, as one endless stream.
//!
//! A point in the overlap of two windows counts as two labels, because it is looked up twice. Handing the points out with
//! their raw and carried ids is part of the weaving.
#![allow(missing_docs)]

#[allow(dead_code)]
mod scenes;

use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use scenes::{Subject, subjects, title, window_sizes};
use streamseg::crew::Crew;
use streamseg::label::Labels;
use streamseg::segmentor::Segmentor;
use streamseg::weaver::{LabelledWindow, Weaver};
use streamseg::window::WindowSize;

/// A segmented window without its points.
struct Labelled {
    first_span: u64,
    span_points: Vec<usize>,
    labels: Labels,
}

fn labelled(subject: &Subject, width: f64, size: WindowSize) -> Vec<Labelled> {
    let segmentor = subject.segmentor();
    let windows = subject.windows(width, size).into_iter();
    windows
        .map(|window| Labelled {
            first_span: window.spans()[0].index,
            span_points: window.spans().iter().map(|span| span.len()).collect(),
            labels: segmentor.segment(&window).expect("proximity never fails").labels,
        })
        .collect()
}

/// A stream that repeats itself without end.
struct Stream {
    windows: Vec<Labelled>,
    weaver: Weaver,
    next_window: u64,
    next_span: u64,
}

impl Stream {
    /// Weaves all windows once more; how many points came out.
    fn weave_once_more(&mut self, crew: &Crew) -> usize {
        let (mut points, first_span) = (0, self.next_span);
        for window in &self.windows {
            let woven = LabelledWindow {
                index: self.next_window,
                first_span: first_span + window.first_span,
                span_points: &window.span_points,
                labels: &window.labels,
                seeded: None,
                agrees: None,
            };
            self.next_window += 1;
            self.next_span = woven.first_span + window.span_points.len() as u64;
            let evicted = self.weaver.weave(&woven, crew);
            points += evicted.iter().map(|span| span.raw_ids.len()).sum::<usize>();
        }
        points
    }
}

fn weaver(criterion: &mut Criterion) {
    for subject in subjects() {
        let mut group = criterion.benchmark_group(format!("weaver, {}", subject.name));
        for width in subject.widths {
            for size in window_sizes() {
                let windows = labelled(&subject, width, size);
                let labels: usize = windows.iter().map(|window| window.labels.of_points().len()).sum();
                let mut stream = Stream { windows, weaver: Weaver::default(), next_window: 0, next_span: 0 };
                group.throughput(Throughput::Elements(labels as u64));
                for threads in [1, 2] {
                    let crew = Crew::new(threads).expect("threads");
                    group.bench_function(title(width, size, threads), |bencher| {
                        bencher.iter(|| stream.weave_once_more(&crew));
                    });
                }
            }
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(800));
    targets = weaver
}
criterion_main!(benches);
