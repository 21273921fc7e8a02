//! Points per second of the proximity segmentor: one window of each scene, and one window per thread side by side.
#![allow(missing_docs)]

#[allow(dead_code)]
mod scenes;

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use scenes::{Subject, subjects, title};
use streamseg::crew::Crew;
use streamseg::segmentor::Segmentor;
use streamseg::window::WindowSize;

fn segmentor(criterion: &mut Criterion) {
    let size = WindowSize::default();
    for subject in subjects() {
        let mut group = criterion.benchmark_group(format!("segmentor, {}", subject.name));
        group.sampling_mode(SamplingMode::Flat);
        for width in subject.widths {
            let windows: Vec<_> = subject.windows(width, size).into_iter().map(Arc::new).collect();
            let window = &windows[windows.len() / 2 - usize::from(windows.len() > 2)];
            for threads in [1, 2] {
                let crew = Crew::new(threads).expect("threads");
                group.throughput(Throughput::Elements((threads * window.len()) as u64));
                group.bench_function(title(width, size, threads), |bencher| {
                    bencher.iter(|| segment_side_by_side(&subject, window, &crew));
                });
            }
        }
    }
}

fn segment_side_by_side(subject: &Subject, window: &Arc<streamseg::window::Window>, crew: &Crew) -> usize {
    let segmentor = subject.segmentor();
    let segments = crew.map(vec![Arc::clone(window); crew.threads()], |window| {
        segmentor.segment(&window).expect("proximity never fails").labels.count()
    });
    segments.into_iter().sum()
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(100))
        .measurement_time(Duration::from_millis(800));
    targets = segmentor
}
criterion_main!(benches);
