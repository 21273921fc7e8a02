//! Streams a cloud through the whole pipeline and gathers everything that is known of its points.
// Each test binary uses what it needs of it.
#![allow(dead_code)]

use std::collections::HashMap;
use std::sync::Arc;

use streamseg::certificate::Certificate;
use streamseg::crew::Crew;
use streamseg::lattice::Lattice;
use streamseg::pipeline::{Outgoing, Pipeline};
use streamseg::segmentor::Segmentor;
use streamseg::settlement::Settlement;
use streamseg::span::{Chunk, PointIds, Source, Span, SpanBy, spans_of};
use streamseg::weaver::{SegmentRow, Selection};
use streamseg::window::{Window, WindowSize};

/// How a cloud is streamed.
#[derive(Debug, Clone)]
pub struct Run {
    pub by: SpanBy,
    pub size: WindowSize,
    pub source: Source,
    /// Sizes of the chunks in which the source delivers, over and over.
    pub chunks: Vec<usize>,
    pub threads: usize,
}

/// What came out, by point id.
#[derive(Debug, PartialEq)]
pub struct Outcome {
    pub raw: Vec<i64>,
    pub carried: Vec<i64>,
    /// The carried ids, made final along the aliases that came with the spans.
    pub with_aliases: Vec<i64>,
    pub resolved_raw: Vec<i64>,
    pub resolved_carried: Vec<i64>,
    pub settled: Vec<i64>,
    pub rows: Vec<SegmentRow>,
    /// Points per span, in the order in which spans came out.
    pub spans: Vec<usize>,
    /// What the run could prove.
    pub certificate: Certificate,
}

/// A chunk of points without attributes.
pub fn chunk(points: &[[f64; 3]]) -> Chunk {
    Chunk { points: points.to_vec(), attributes: vec![] }
}

/// Cuts `points` into chunks of the given sizes, over and over.
pub fn chunks_of(points: &[[f64; 3]], sizes: &[usize]) -> Vec<Chunk> {
    chunks_with(points, &[], sizes)
}

/// The same with a column for each attribute.
pub fn chunks_with(points: &[[f64; 3]], attributes: &[Vec<f64>], sizes: &[usize]) -> Vec<Chunk> {
    assert!(sizes.iter().any(|&size| size > 0));
    let mut chunks = Vec::new();
    let mut begin = 0;
    for &size in sizes.iter().cycle() {
        if begin == points.len() {
            break;
        }
        let taken = begin..(begin + size).min(points.len());
        begin = taken.end;
        let attributes = attributes.iter().map(|column| column[taken.clone()].to_vec()).collect();
        chunks.push(Chunk { points: points[taken].to_vec(), attributes });
    }
    chunks
}

/// The pipeline of a run over `points`.
pub fn pipeline(points: &[[f64; 3]], lattice: Lattice, segmentor: Arc<dyn Segmentor>, run: &Run) -> Pipeline {
    pipeline_with(points, &[], lattice, segmentor, run)
}

/// The same with a column for each attribute that the segmentor reads.
pub fn pipeline_with(
    points: &[[f64; 3]],
    attributes: &[Vec<f64>],
    lattice: Lattice,
    segmentor: Arc<dyn Segmentor>,
    run: &Run,
) -> Pipeline {
    let chunks = chunks_with(points, attributes, &run.chunks).into_iter().map(Ok);
    let spans = spans_of(chunks, run.by, &lattice, run.source).unwrap();
    Pipeline::new(spans, lattice, segmentor, run.size, Crew::new(run.threads).unwrap())
}

/// Streams `points` to the end.
///
/// # Panics
/// If a point does not come out exactly once, or anything fails.
pub fn stream(points: &[[f64; 3]], lattice: Lattice, segmentor: Arc<dyn Segmentor>, run: &Run) -> Outcome {
    stream_with(points, &[], lattice, segmentor, run)
}

/// Streams `points` with a column for each attribute that the segmentor reads.
pub fn stream_with(
    points: &[[f64; 3]],
    attributes: &[Vec<f64>],
    lattice: Lattice,
    segmentor: Arc<dyn Segmentor>,
    run: &Run,
) -> Outcome {
    outcome(pipeline_with(points, attributes, lattice, segmentor, run), points.len())
}

/// Runs a pipeline over so many points to the end.
///
/// # Panics
/// As [`stream`].
pub fn outcome(mut pipeline: Pipeline, points: usize) -> Outcome {
    let outgoing: Vec<Outgoing> = pipeline.by_ref().map(Result::unwrap).collect();
    assert!(pipeline.next().is_none(), "an exhausted pipeline stays so");
    assert_eq!((pipeline.weaver().live_points(), pipeline.weaver().live_segments()), (0, 0));

    let point_ids: Vec<Vec<i64>> = outgoing.iter().map(|out| point_ids(&out.span)).collect();
    let by_point = |ids: &dyn Fn(usize) -> Vec<i64>| once_each(points, &point_ids, ids);
    let raw = by_point(&|span| outgoing[span].segmented.raw_ids.clone());
    let carried = by_point(&|span| outgoing[span].segmented.carried_ids.clone());
    let (mut resolved_raw, mut resolved_carried) = (raw.clone(), carried.clone());
    pipeline.aliases().resolve(&mut resolved_raw, &Selection::default()).unwrap();
    pipeline.aliases().resolve(&mut resolved_carried, &Selection::default()).unwrap();
    let settled = settle(&mut pipeline, &outgoing, &point_ids);
    Outcome {
        with_aliases: follow(&carried, outgoing.iter().flat_map(|out| &out.segmented.aliases)),
        settled: by_point(&|span| settled[span].clone()),
        rows: outgoing.iter().flat_map(|out| out.segmented.segments.clone()).collect(),
        spans: outgoing.iter().map(|out| out.span.len()).collect(),
        certificate: pipeline.certificate(),
        raw,
        carried,
        resolved_raw,
        resolved_carried,
    }
}

/// The whole cloud as one window.
pub fn static_labels(points: &[[f64; 3]], lattice: Lattice, segmentor: &dyn Segmentor) -> Vec<i64> {
    static_labels_with(points, &[], lattice, segmentor)
}

/// The whole cloud as one window, with a column for each attribute that the segmentor reads.
pub fn static_labels_with(
    points: &[[f64; 3]],
    attributes: &[Vec<f64>],
    lattice: Lattice,
    segmentor: &dyn Segmentor,
) -> Vec<i64> {
    let (points, attributes) = (points.to_vec(), attributes.to_vec());
    let span = Span { index: 0, point_ids: PointIds::From(0), points, attributes, extent: None };
    let window = Window::with_halo(0, vec![Arc::new(span)], 0..1, lattice, &segmentor.reads());
    let labels = segmentor.segment(&window).unwrap();
    // Whatever the cause, no label is no label.
    labels.labels.of_points().iter().map(|&label| i64::from(label.max(-1))).collect()
}

/// The point ids of a span.
pub fn point_ids(span: &Span) -> Vec<i64> {
    (0..span.len()).map(|position| span.point_id(position)).collect()
}

fn once_each(points: usize, point_ids: &[Vec<i64>], ids: &dyn Fn(usize) -> Vec<i64>) -> Vec<i64> {
    let mut of_point = vec![None; points];
    for (span, point_ids) in point_ids.iter().enumerate() {
        let ids = ids(span);
        assert_eq!(ids.len(), point_ids.len(), "span {span}");
        for (&point, id) in point_ids.iter().zip(ids) {
            assert!(of_point[point as usize].replace(id).is_none(), "point {point} came out twice");
        }
    }
    of_point.into_iter().map(|id| id.expect("every point comes out")).collect()
}

fn settle(pipeline: &mut Pipeline, outgoing: &[Outgoing], point_ids: &[Vec<i64>]) -> Vec<Vec<i64>> {
    let mut settlement = Settlement::default();
    for (out, point_ids) in outgoing.iter().zip(point_ids) {
        let segmented = &out.segmented;
        settlement.keep(segmented.index, point_ids, &segmented.carried_ids, &[], segmented.settles_at).unwrap();
    }
    settlement.settle(pipeline.aliases(), &Selection::default()).unwrap();
    settlement.map(|span| span.unwrap().segment_ids).collect()
}

/// What ids become if each is replaced by what its alias says, until no alias is left.
pub fn follow<'a>(ids: &[i64], aliases: impl IntoIterator<Item = &'a [i64; 2]>) -> Vec<i64> {
    let mut becomes: HashMap<i64, i64> = HashMap::new();
    for &[id, smaller] in aliases {
        assert!(smaller < id && becomes.insert(id, smaller).is_none(), "alias {id} -> {smaller}");
    }
    let end = |&id: &i64| std::iter::successors(Some(id), |id| becomes.get(id).copied()).last().unwrap_or(id);
    ids.iter().map(end).collect()
}
