//! The scenes that are measured, made once with fixed seeds, and how they are cut.
//!
//! | scene | points | distance | spans |
//! |---|---|---|---|
//! | airborne | a flight strip, 200 m wide, nine points per square metre | 1 m | 10, 25, 50 m |
//! | street | a drive along a street, five thousand points per metre | 0.3 m | 2, 5, 10 m |
//! | plane | flat ground, eight points per square metre: one segment in all windows, the worst case for joins | 1 m | 10, 25, 50 m |

use std::sync::Arc;

use streamseg::lattice::{Lattice, Metric};
use streamseg::scene::{OFFSET, SCALE, Scene};
use streamseg::segmentor::Proximity;
use streamseg::span::{Chunk, Direction, Source, Span, SpanBy, spans_of};
use streamseg::window::{Slider, Window, WindowSize};

/// Points per chunk, as a file reader would deliver them.
const CHUNK: usize = 50_000;

/// A cloud with what it takes to segment it.
pub struct Subject {
    /// As printed.
    pub name: &'static str,
    /// Lattice coordinates, in the order of measurement.
    pub points: Vec<[f64; 3]>,
    /// Of the proximity segmentor.
    pub distance: f64,
    /// Span widths, metres.
    pub widths: [f64; 3],
}

/// How many points each scene has; `STREAMSEG_BENCH_POINTS` changes it.
pub fn points() -> usize {
    std::env::var("STREAMSEG_BENCH_POINTS").map_or(500_000, |points| points.parse().expect("a number of points"))
}

/// All scenes.
pub fn subjects() -> Vec<Subject> {
    let of = |scene: Scene| scene.take(points()).map(|point| point.position.map(f64::from)).collect();
    vec![
        Subject { name: "airborne", points: of(Scene::airborne_strip(1)), distance: 1.0, widths: [10.0, 25.0, 50.0] },
        Subject { name: "street", points: of(Scene::street(1)), distance: 0.3, widths: [2.0, 5.0, 10.0] },
        Subject { name: "plane", points: plane(), distance: 1.0, widths: [10.0, 25.0, 50.0] },
    ]
}

/// Points 0.35 m apart, each shifted a little, row by row across a strip of 200 m.
fn plane() -> Vec<[f64; 3]> {
    const ACROSS: usize = 571;
    const STEP: f64 = 350.0;
    let shift = |i: usize, prime: usize| (i.wrapping_mul(prime) >> 7) as f64 % 200.0;
    (0..points())
        .map(|i| {
            let (row, column) = ((i / ACROSS) as f64, (i % ACROSS) as f64);
            [row * STEP + shift(i, 2_654_435_761), column * STEP + shift(i, 2_246_822_519), 0.0]
        })
        .collect()
}

impl Subject {
    /// The lattice of the coordinates.
    pub fn lattice() -> Lattice {
        Lattice::new([SCALE; 3], OFFSET).expect("a valid lattice")
    }

    /// The segmentor that is measured.
    pub fn segmentor(&self) -> Arc<Proximity> {
        Arc::new(Proximity::new(self.distance, Metric::Xyz).expect("a valid distance"))
    }

    /// The cloud as a source delivers it.
    pub fn chunks(&self) -> Vec<Chunk> {
        self.points.chunks(CHUNK).map(|points| Chunk { points: points.to_vec(), attributes: vec![] }).collect()
    }

    /// The rule by which spans are cut.
    pub fn by(width: f64) -> SpanBy {
        SpanBy::Width { width, direction: Direction::X }
    }

    fn spans(&self, width: f64) -> impl Iterator<Item = Span> {
        let chunks = self.chunks().into_iter().map(Ok);
        let spans = spans_of(chunks, Self::by(width), &Self::lattice(), Source::Stored).expect("a valid width");
        spans.map(|span| span.expect("nothing fails"))
    }

    /// All windows over the cloud.
    pub fn windows(&self, width: f64, size: WindowSize) -> Vec<Window> {
        let mut slider = Slider::new(size, Self::lattice());
        let mut windows: Vec<Window> = Vec::new();
        for span in self.spans(width) {
            slider.push(span);
            windows.extend(slider.next_window());
        }
        slider.end();
        windows.extend(slider.next_window());
        windows
    }
}

/// The window sizes that are measured: the paper's, and one with less overlap.
pub fn window_sizes() -> [WindowSize; 2] {
    [(3, 1), (6, 1)].map(|(spans, overlap)| WindowSize::new(spans, overlap).expect("a window that moves"))
}

/// How a configuration is printed.
pub fn title(width: f64, size: WindowSize, threads: usize) -> String {
    format!("{width} m, window {}/{}, {threads} threads", size.spans(), size.overlap())
}
