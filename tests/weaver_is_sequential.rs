//! The weaver against its slow sequential twin, on random labels: ids, tables, history, aliases.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

#[allow(dead_code)]
mod clouds;
#[allow(dead_code)]
mod oracle;

use std::collections::HashMap;

use clouds::cases;
use oracle::weaver::{Gone, SequentialWeaver};
use proptest::prelude::*;
use streamseg::crew::Crew;
use streamseg::label::{Labels, NONE, SegmentId};
use streamseg::weaver::{Carry, EvictedSpan, Join, LabelledWindow, PointSegment, Replay, SegmentRow, Weaver};
use streamseg::window::WindowSize;

/// A stream of spans and what a segmentor might say of each window.
#[derive(Debug, Clone)]
struct Script {
    span_points: Vec<usize>,
    size: WindowSize,
    /// Source of labels: the `i`-th labelled point takes the `i`-th, over and over.
    labels: Vec<i64>,
}

impl Script {
    /// First span and number of spans of every window.
    fn windows(&self) -> Vec<(usize, usize)> {
        let (spans, advance) = (self.span_points.len(), self.size.advance());
        let mut windows = Vec::new();
        let mut first = 0;
        while first < spans && (first == 0 || first + self.size.overlap() < spans) {
            windows.push((first, self.size.spans().min(spans - first)));
            first += advance;
        }
        windows
    }

    fn play(&self, mut window: impl FnMut(u64, u64, &[usize], &Labels)) {
        let mut labels = self.labels.iter().copied().cycle();
        for (index, (first, spans)) in self.windows().into_iter().enumerate() {
            let span_points = &self.span_points[first..first + spans];
            let of_window: Vec<i64> = labels.by_ref().take(span_points.iter().sum()).collect();
            window(index as u64, first as u64, span_points, &Labels::from_any(&of_window));
        }
    }
}

fn script() -> impl Strategy<Value = Script> {
    let size = (1usize..6).prop_flat_map(|spans| (Just(spans), 0..spans));
    let label = prop_oneof![2 => Just(NONE), 5 => 0i64..6, 1 => 0i64..40];
    (prop::collection::vec(0usize..6, 0..14), size, prop::collection::vec(label, 1..200)).prop_map(
        |(span_points, (spans, overlap), labels)| Script {
            span_points,
            size: WindowSize::new(spans, overlap).unwrap(),
            labels,
        },
    )
}

fn as_gone(evicted: &EvictedSpan) -> Gone {
    Gone {
        span: evicted.index,
        raw_ids: evicted.raw_ids.clone(),
        carried_ids: evicted.carried_ids.clone(),
        segments: evicted.segments.clone(),
    }
}

/// Weaves a script and its twin side by side and compares after every window.
fn weave(script: &Script, threads: usize) -> Result<(Weaver, Vec<EvictedSpan>, SequentialWeaver), TestCaseError> {
    let (mut weaver, mut twin) = (Weaver::default(), SequentialWeaver::default());
    let crew = Crew::new(threads).unwrap();
    let (mut evicted, mut gone): (Vec<EvictedSpan>, Vec<Gone>) = (Vec::new(), Vec::new());
    let mut live = Vec::new();
    script.play(|index, first_span, span_points, labels| {
        let window = LabelledWindow { index, first_span, span_points, labels };
        evicted.extend(weaver.weave(&window, &crew));
        gone.extend(twin.weave(index as i64, first_span, span_points, labels.of_points()));
        live.push([weaver.live_points(), twin.point_segment.len()]);
        live.push([weaver.live_segments(), twin.segment_segment.len()]);
    });
    for [live, expected] in live {
        prop_assert_eq!(live, expected, "live entries");
    }
    evicted.extend(weaver.finish());
    gone.extend(twin.finish());
    prop_assert_eq!(evicted.iter().map(as_gone).collect::<Vec<_>>(), gone);
    prop_assert_eq!((weaver.live_points(), weaver.live_segments()), (0, 0));
    Ok((weaver, evicted, twin))
}

fn gather(evicted: &[EvictedSpan], ids: impl Fn(&EvictedSpan) -> &[SegmentId]) -> Vec<SegmentId> {
    evicted.iter().flat_map(|span| ids(span).to_vec()).collect()
}

proptest! {
    #![proptest_config(cases(512))]

    /// Raw ids, carried ids, rows of the history and live entries after every window; and what ids become in the end.
    #[test]
    fn the_weaver_is_its_sequential_twin(script in script(), threads in 1usize..3) {
        let (mut weaver, evicted, twin) = weave(&script, threads)?;
        let raw = gather(&evicted, |span| &span.raw_ids);
        let settled = twin.carried();
        let settled: Vec<SegmentId> =
            raw.iter().map(|&id| if id == NONE { NONE } else { settled[id as usize] }).collect();
        for mut ids in [raw, gather(&evicted, |span| &span.carried_ids)] {
            weaver.aliases().resolve(&mut ids).unwrap();
            prop_assert_eq!(&ids, &settled);
        }
    }

    /// Whoever keeps the carried ids and follows the aliases ends with the final ids.
    #[test]
    fn aliases_make_carried_ids_final(script in script()) {
        let (mut weaver, evicted, _) = weave(&script, 1)?;
        let carried = gather(&evicted, |span| &span.carried_ids);
        let mut settled = carried.clone();
        weaver.aliases().resolve(&mut settled).unwrap();
        let becomes: HashMap<i64, i64> =
            evicted.iter().flat_map(|span| &span.aliases).map(|&[id, smaller]| (id, smaller)).collect();
        let end = |&id: &i64| std::iter::successors(Some(id), |id| becomes.get(id).copied()).last().unwrap();
        prop_assert_eq!(carried.iter().map(end).collect::<Vec<_>>(), settled);
    }

    /// A history that is played back settles to the same ids.
    #[test]
    fn a_replayed_history_settles_to_the_same_ids(script in script()) {
        let (mut weaver, evicted, _) = weave(&script, 1)?;
        let mut replay = Replay::new(weaver.next_id() - 1);
        let mut parts = Vec::new();
        for span in &evicted {
            let rows: Vec<[SegmentId; 2]> =
                span.segments.iter().map(|row| [row.segment_id, row.next_segment_id]).collect();
            let mut ids = span.raw_ids.clone();
            let settles_at = replay.part(&rows, &mut ids).unwrap();
            parts.push((ids, settles_at));
        }
        let mut settling = replay.aliases().settling();
        for ((ids, settles_at), span) in parts.iter_mut().zip(&evicted).rev() {
            settling.rewind(replay.aliases(), *settles_at, |_, _| ()).unwrap();
            settling.settle(ids);
            let mut expected = span.raw_ids.clone();
            weaver.aliases().resolve(&mut expected).unwrap();
            prop_assert_eq!(&*ids, &expected);
        }
    }
}

/// Windows of more points than one thread takes at a time.
#[test]
fn threads_that_share_a_window_give_the_ids_of_one() {
    let script = Script {
        span_points: vec![30_000, 70_001, 0, 45_000, 99_999, 1, 64_000],
        size: WindowSize::new(3, 2).unwrap(),
        labels: (0..99_991i64).map(|i| if i % 7 == 0 { NONE } else { i * i % 1_013 / 2 }).collect(),
    };
    let woven = |threads| {
        let (mut weaver, crew, mut evicted) = (Weaver::default(), Crew::new(threads).unwrap(), Vec::new());
        script.play(|index, first_span, span_points, labels| {
            evicted.extend(weaver.weave(&LabelledWindow { index, first_span, span_points, labels }, &crew));
        });
        evicted.extend(weaver.finish());
        evicted
    };
    let one = woven(1);
    assert!(one.iter().flat_map(|span| &span.segments).any(|row: &SegmentRow| row.shared_points > 1));
    assert!((2..5).all(|threads| woven(threads) == one));
}

/// Found by `aliases_make_carried_ids_final`: 3 has been handed out and becomes 2, which has not; when 2 becomes 1,
/// whoever keeps the ids needs to know that too.
#[test]
fn an_alias_to_an_id_that_was_never_handed_out_is_continued() {
    let mut carry = Carry::default();
    carry.extend(3);
    carry.hand_out(3);
    assert_eq!(carry.join(2, 3), Some(Join { id: 3, becomes: 2, is_alias: true }));
    assert_eq!(carry.join(1, 2), Some(Join { id: 2, becomes: 1, is_alias: true }));
}

/// A point without a segment keeps none, however many laps of the ring ago its place was last written.
#[test]
fn a_place_of_the_ring_that_is_not_written_for_256_laps_is_empty() {
    let mut table = PointSegment::with_capacity(2);
    let first = table.extend(2);
    table.insert_if_absent(first, 7);
    for _ in 0..600 {
        let arrival = table.extend(2) - 1;
        table.evict_before(arrival + 1);
        assert_eq!([1, 2].map(|ahead| table.get(arrival + ahead)), [None, None], "arrival {}", arrival + 1);
    }
}
