//! Points per second of the whole framework, from chunks in any order to spans with segment ids; and the weaver's share
//! of the time.
#![allow(missing_docs)]
#![allow(clippy::print_stdout)]

#[allow(dead_code)]
mod scenes;

use std::time::{Duration, Instant};

use criterion::{BatchSize, Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use scenes::{Subject, subjects, title};
use streamseg::crew::Crew;
use streamseg::pipeline::Pipeline;
use streamseg::span::{Chunk, Source, spans_of};
use streamseg::window::WindowSize;

/// Which of the scene's widths, spans per window (one of them overlaps), threads.
const CONFIGURATIONS: [(usize, usize, usize); 5] = [(0, 6, 1), (1, 3, 1), (1, 3, 2), (1, 6, 2), (2, 3, 1)];

/// What was spent on weaving, and in all.
#[derive(Default)]
struct Shares {
    weaving: Duration,
    all: Duration,
}

fn run(
    subject: &Subject,
    chunks: Vec<Chunk>,
    width: f64,
    size: WindowSize,
    threads: usize,
    shares: &mut Shares,
) -> u64 {
    let begun = Instant::now();
    let lattice = Subject::lattice();
    let spans = spans_of(chunks.into_iter().map(Ok), Subject::by(width), &lattice, Source::Stored);
    let crew = Crew::new(threads).expect("threads");
    let mut pipeline = Pipeline::new(spans.expect("a valid width"), lattice, subject.segmentor(), size, crew);
    for span in pipeline.by_ref() {
        span.expect("nothing fails");
    }
    shares.weaving += pipeline.progress().weaving;
    shares.all += begun.elapsed();
    pipeline.progress().points
}

fn pipeline(criterion: &mut Criterion) {
    for subject in subjects() {
        let mut group = criterion.benchmark_group(format!("pipeline, {}", subject.name));
        group.sampling_mode(SamplingMode::Flat);
        group.throughput(Throughput::Elements(subject.points.len() as u64));
        for (width, spans, threads) in CONFIGURATIONS {
            let (width, size) = (subject.widths[width], WindowSize::new(spans, 1).expect("a window that moves"));
            let (title, mut shares) = (title(width, size, threads), Shares::default());
            group.bench_function(&title, |bencher| {
                bencher.iter_batched(
                    || subject.chunks(),
                    |chunks| run(&subject, chunks, width, size, threads, &mut shares),
                    BatchSize::PerIteration,
                );
            });
            if !shares.all.is_zero() {
                let share = 100.0 * shares.weaving.as_secs_f64() / shares.all.as_secs_f64();
                println!("{}, {title}: {share:.2} % of the time is the weaver's", subject.name);
            }
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(1))
        .measurement_time(Duration::from_secs(1));
    targets = pipeline
}
criterion_main!(benches);
