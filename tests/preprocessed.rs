//! A cloud that is preprocessed and then segmented, as a stream and at once.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod oracle;
mod streaming;

use std::sync::Arc;

use oracle::partition::canonical;
use streaming::{Run, chunks_of, static_labels, stream};
use streamseg::features::Fit;
use streamseg::lattice::{Lattice, Metric};
use streamseg::preprocessing::{
    Dialect, RadiusOutlierRemoval, Representative, Stage, StatisticalOutlierRemoval, VoxelGrid, apply_all, measure,
};
use streamseg::recipe::{Ingredients, Recipe};
use streamseg::segmentor::{Proximity, Segmentor};
use streamseg::span::{Direction, PointIds, Source, Span, SpanBy, spans_of};
use streamseg::window::{Window, WindowSize};

fn recipe(stages: Vec<Arc<dyn Stage>>) -> Recipe {
    let segmentor = Arc::new(Proximity::new(1.2, Metric::Xy).unwrap());
    let ingredients = Ingredients { stages, filter: None, seed_filter: None, fit: Fit::default(), segmentor };
    Recipe::new(ingredients, &[], false).unwrap()
}

/// 2000 points in centimeters, 80 m by 60 m, as if by chance; every tenth is the neighbor of another.
fn sparse_cloud() -> Vec<[f64; 3]> {
    let mut state = 1u64;
    let mut below = |limit: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % limit) as f64
    };
    let mut points: Vec<[f64; 3]> = (0..1800).map(|_| [below(8000), below(6000), below(50)]).collect();
    for i in 0..200 {
        let [x, y, z] = points[9 * i];
        points.push([x + below(40), y + below(40), z]);
    }
    points
}

#[test]
fn segments_of_a_preprocessed_cloud_are_the_same_streamed_and_at_once() {
    let lattice = Lattice::new([0.01; 3], [500_000.0, 5_400_000.0, 0.0]).unwrap();
    let points = sparse_cloud();
    let by = |width, direction| SpanBy::Width { width, direction };
    let removal = StatisticalOutlierRemoval::new(6, 2.0, Dialect::Pcl).unwrap();
    let voxels: Arc<dyn Stage> = Arc::new(VoxelGrid::new(0.8, Representative::Centroid).unwrap());
    let mut open = || {
        let chunks = chunks_of(&points, &[1000]).into_iter().map(Ok);
        spans_of(chunks, by(20.0, Direction::X), &lattice, Source::Stored)
    };
    let earlier = [Arc::clone(&voxels)];
    let statistics = measure(removal, &earlier, &mut open, lattice, 5.0, 1, &mut || Box::new(|| Ok(()))).unwrap();
    let stages: Vec<Arc<dyn Stage>> = vec![
        voxels,
        Arc::new(removal.with_statistics(statistics)),
        Arc::new(RadiusOutlierRemoval::new(1.5, 1).unwrap()),
    ];
    let span =
        Span { index: 0, point_ids: PointIds::From(0), points: points.clone(), attributes: vec![], extent: None };
    let left = apply_all(&stages, &Window::new(0, vec![Arc::new(span)], lattice)).unwrap().window.points().len();
    assert!(100 < left && left < 1900, "{left} are left");

    let whole = static_labels(&points, lattice, &recipe(stages.clone()));
    assert!(whole.iter().any(|&label| label > 20) && whole.contains(&-1));
    for (width, direction, threads) in
        [(6.0, Direction::X, 1), (11.0, Direction::Y, 2), (9.0, Direction::Azimuth(30.0), 2)]
    {
        let segmentor = Arc::new(recipe(stages.clone()));
        let size = WindowSize::default();
        let assessment = segmentor.exactness().assess(by(width, direction), size, &lattice);
        assert!(assessment.is_identical && assessment.class == 'B', "{assessment:?}");
        let run = Run { by: by(width, direction), size, source: Source::Stored, chunks: vec![700], threads };
        let streamed = stream(&points, lattice, segmentor, &run);
        assert!(canonical(&streamed.settled) == canonical(&whole), "{width} {direction:?}");
    }
}
