//! The weaver against its slow sequential twin, on random labels: ids, tables, history, aliases.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

mod clouds;
mod oracle;

use std::collections::{HashMap, HashSet};

use clouds::cases;
use oracle::weaver::{Gone, Said, SequentialWeaver};
use proptest::prelude::*;
use streamseg::crew::Crew;
use streamseg::label::{Labels, NONE, SegmentId};
use streamseg::settlement::Settlement;
use streamseg::size::{SizeLimits, Sort};
use streamseg::weaver::{
    Agreement, Carry, Closed, EvictedSpan, Join, LabelledWindow, OutOfScope, PointSegment, Replay, Returned,
    SegmentRow, Selection, Weaver,
};
use streamseg::window::WindowSize;

/// A stream of spans and what a segmentor might say of each window.
#[derive(Debug, Clone)]
struct Script {
    span_points: Vec<usize>,
    size: WindowSize,
    /// Source of labels: the `i`-th labelled point takes the `i`-th, over and over.
    labels: Vec<i64>,
    /// A label holds a seed unless this divides the sum of its number and its window's; 0 = seeds are not asked for.
    seedless: u64,
    /// A segment and a label agree unless this divides the sum of their numbers; 0 = agreement is not asked for.
    disagree: i64,
    /// Late joins: after which window, of which segments, if there are so many by then. Every other one is of points that
    /// returned to the window.
    late: Vec<(u64, [SegmentId; 2])>,
}

/// Points of a returned segment, more than a window has, so that the rows can be told from others.
const MANY: u64 = 1 << 40;

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

    /// The late joins that come with a window with so many segments so far, `first` being the first of its own: those of
    /// returned points, and the others.
    fn late(&self, window: u64, first: SegmentId, next: SegmentId) -> (Vec<Returned>, Vec<[SegmentId; 2]>) {
        let of_window = self.late.iter().filter(|(at, [a, b])| *at == window && a.max(b) < &next);
        let is_returned = |[a, b]: &[SegmentId; 2]| a % 2 == 0 && first <= *b;
        let (returned, others): (Vec<_>, Vec<_>) = of_window.map(|(_, pair)| *pair).partition(is_returned);
        let returned = returned.into_iter().map(|[segment_id, b]| Returned {
            segment_id,
            label: (b - first) as i32,
            points: MANY,
        });
        (returned.collect(), others)
    }

    fn is_seeded(&self, window: u64, label: i32) -> bool {
        self.seedless == 0 || !(window + label as u64).is_multiple_of(self.seedless)
    }

    fn agrees(&self, from: SegmentId, label: i32) -> bool {
        self.disagree == 0 || (from + SegmentId::from(label)) % self.disagree != 0
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
    let rules = (prop_oneof![Just(0u64), 1u64..4], prop_oneof![Just(0i64), 1i64..5]);
    let late = prop::collection::vec((0u64..12, [1i64..30, 1i64..30]), 0..12);
    (prop::collection::vec(0usize..6, 0..14), size, prop::collection::vec(label, 1..200), rules, late).prop_map(
        |(span_points, (spans, overlap), labels, (seedless, disagree), late)| Script {
            span_points,
            size: WindowSize::new(spans, overlap).unwrap(),
            labels,
            seedless,
            disagree,
            late,
        },
    )
}

/// The limits and the order that somebody may ask for.
fn selections() -> impl Strategy<Value = (SizeLimits, Sort)> {
    let limits = (1usize..6, prop::option::of(0usize..8));
    let limits = limits.prop_map(|(min, more)| SizeLimits::new(min, more.map(|more| min + more)).unwrap());
    (limits, prop::sample::select(vec![Sort::Native, Sort::Ascending, Sort::Descending]))
}

fn as_gone(evicted: &EvictedSpan) -> Gone {
    Gone {
        span: evicted.index,
        raw_ids: evicted.raw_ids.clone(),
        carried_ids: evicted.carried_ids.clone(),
        segments: evicted.segments.iter().filter(|row| !is_late(row)).copied().collect(),
    }
}

fn is_late(row: &SegmentRow) -> bool {
    row.next_segment_id != NONE && (row.shared_points == 0 || row.shared_points == MANY)
}

/// Weaves a script and its twin side by side and compares after every window.
fn weave(script: &Script, threads: usize) -> Result<(Weaver, Vec<EvictedSpan>, SequentialWeaver), TestCaseError> {
    let awaited: Vec<SegmentId> = script.late.iter().flat_map(|(_, pair)| *pair).collect();
    // All ways to remember those that have gone.
    let out_of_scope = match script.labels.len() % 3 {
        0 => OutOfScope::all(),
        1 => OutOfScope::all_but_few_on_disk(3),
        _ => OutOfScope::awaited(),
    };
    let (mut weaver, mut twin) = (Weaver::with_late_joins(out_of_scope), SequentialWeaver::default());
    let mut late_rows = Vec::new();
    let crew = Crew::new(threads).unwrap();
    let (mut evicted, mut gone): (Vec<EvictedSpan>, Vec<Gone>) = (Vec::new(), Vec::new());
    let mut live = Vec::new();
    let mut early = Vec::new();
    let agrees = |from, label| script.agrees(from, label);
    script.play(|index, first_span, span_points, labels| {
        let is_seeded = |label| script.is_seeded(index, label);
        let seeded: Vec<bool> = (0..labels.count() as i32).map(is_seeded).collect();
        let first = weaver.next_id();
        let (returned, late) = script.late(index, first, first + labels.count() as i64);
        let window = LabelledWindow {
            index,
            first_span,
            span_points,
            labels,
            seeded: (script.seedless > 0).then_some(&seeded),
            agrees: if script.disagree > 0 { Some(&agrees) } else { None },
        };
        weaver.await_segments(&awaited.iter().copied().filter(|id| *id < first).collect::<Vec<_>>());
        evicted.extend(weaver.weave(&window, &crew));
        weaver.join_returned(&returned, first, index).unwrap();
        weaver.join_late(&late, index).unwrap();
        let said = Said { labels: labels.of_points(), is_seeded: &is_seeded, agrees: &agrees };
        gone.extend(twin.weave(index as i64, first_span, span_points, &said));
        let returned = returned.iter().map(|r| ([r.segment_id, first + i64::from(r.label)], MANY));
        for ([a, b], shared_points) in returned.chain(late.iter().map(|pair| (*pair, 0))).filter(|([a, b], _)| a != b) {
            twin.join(a, b);
            let (segment_id, next_segment_id) = (a.min(b), a.max(b));
            late_rows.push(SegmentRow { segment_id, next_segment_id, window: index as i64, shared_points });
        }
        live.push([weaver.live_points(), twin.point_segment.len()]);
        live.push([weaver.live_segments(), twin.segment_segment.len()]);
        let can_be_closed = twin.closed();
        early.extend(closed(&mut weaver).into_iter().filter(|whole| can_be_closed.binary_search(&whole.id).is_err()));
        let oldest = twin.segment_segment.keys().next().copied().unwrap_or(SegmentId::MAX);
        assert!(weaver.oldest_live_id() <= oldest.min(weaver.next_id()));
    });
    for [live, expected] in live {
        prop_assert_eq!(live, expected, "live entries");
    }
    prop_assert_eq!(early, [], "closed too early");
    evicted.extend(weaver.finish());
    gone.extend(twin.finish());
    prop_assert_eq!(evicted.iter().map(as_gone).collect::<Vec<_>>(), gone);
    late_rows.sort_unstable();
    late_rows.dedup();
    prop_assert_eq!(told_late(&evicted)?, late_rows);
    prop_assert_eq!((weaver.live_points(), weaver.live_segments()), (0, 0));
    prop_assert_eq!(weaver.oldest_live_id(), weaver.next_id());
    Ok((weaver, evicted, twin))
}

/// The rows of late joins, none of which is told before its segment tells its own.
fn told_late(evicted: &[EvictedSpan]) -> Result<Vec<SegmentRow>, TestCaseError> {
    let (mut gone, mut late) = (HashSet::new(), Vec::new());
    for row in evicted.iter().flat_map(|span| &span.segments) {
        if is_late(row) {
            prop_assert!(gone.contains(&row.segment_id), "{:?} came too early", row);
            late.push(*row);
        } else {
            gone.insert(row.segment_id);
        }
    }
    late.sort_unstable();
    Ok(late)
}

/// What has been closed so far, by id.
fn closed(weaver: &mut Weaver) -> Vec<Closed> {
    let mut closed = Vec::new();
    weaver.aliases().for_each_closed(|whole| closed.push(*whole)).unwrap();
    closed.sort_unstable_by_key(|whole| whole.id);
    closed
}

/// What the id of each whole becomes, by its size: the slow way, from all wholes at once.
fn selected(wholes: &[Closed], limits: SizeLimits, sort: Sort) -> HashMap<SegmentId, SegmentId> {
    let in_limits = |points| limits.min() <= points && limits.max().is_none_or(|max| points <= max);
    let mut kept: Vec<&Closed> = wholes.iter().filter(|whole| whole.has_seed && in_limits(whole.points)).collect();
    // The wholes come by id, and sorting is stable.
    match sort {
        Sort::Native => return kept.iter().map(|whole| (whole.id, whole.id)).collect(),
        Sort::Ascending => kept.sort_by_key(|whole| whole.points),
        Sort::Descending => kept.sort_by_key(|whole| std::cmp::Reverse(whole.points)),
    }
    kept.iter().zip(1..).map(|(whole, number)| (whole.id, number)).collect()
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
            weaver.aliases().resolve(&mut ids, &Selection::default()).unwrap();
            prop_assert_eq!(&ids, &settled);
        }
        prop_assert_eq!(closed(&mut weaver), twin.wholes());
    }

    /// Limits, seeds and order: of settled spans, and of any ids that are asked for.
    #[test]
    fn final_ids_are_selected_by_the_sizes_of_the_twin(
        script in script(),
        (limits, sort) in selections(),
        threads in 1usize..3
    ) {
        let (mut weaver, evicted, twin) = weave(&script, threads)?;
        let whole_of = twin.carried();
        let becomes = selected(&twin.wholes(), limits, sort);
        let select = |&id: &SegmentId| if id == NONE { NONE } else { *becomes.get(&whole_of[id as usize]).unwrap_or(&NONE) };
        let raw = gather(&evicted, |span| &span.raw_ids);
        let expected: Vec<SegmentId> = raw.iter().map(select).collect();

        let selection = Selection::new(weaver.aliases(), limits, sort).unwrap();
        for mut ids in [raw.clone(), gather(&evicted, |span| &span.carried_ids)] {
            weaver.aliases().resolve(&mut ids, &selection).unwrap();
            prop_assert_eq!(&ids, &expected);
        }
        let mut settlement = Settlement::default();
        for span in &evicted {
            settlement.keep(span.index, &vec![0; span.raw_ids.len()], &span.carried_ids, &[], span.settles_at).unwrap();
        }
        settlement.settle(weaver.aliases(), &selection).unwrap();
        let settled: Vec<SegmentId> = settlement.flat_map(|span| span.unwrap().segment_ids).collect();
        prop_assert_eq!(&settled, &expected);

        let left_out: HashMap<SegmentId, u64> = twin
            .wholes()
            .iter()
            .filter(|whole| whole.points > 0 && !becomes.contains_key(&whole.id))
            .map(|whole| (whole.id, whole.points))
            .collect();
        prop_assert_eq!(selection.kept_segments(), becomes.len() as u64);
        prop_assert_eq!(selection.left_out_segments().total(), left_out.len() as u64);
        prop_assert_eq!(selection.left_out_points().total(), left_out.values().sum::<u64>());
    }

    /// Whoever keeps the carried ids and follows the aliases ends with the final ids.
    #[test]
    fn aliases_make_carried_ids_final(script in script()) {
        let (mut weaver, evicted, _) = weave(&script, 1)?;
        let carried = gather(&evicted, |span| &span.carried_ids);
        let mut settled = carried.clone();
        weaver.aliases().resolve(&mut settled, &Selection::default()).unwrap();
        let becomes: HashMap<i64, i64> =
            evicted.iter().flat_map(|span| &span.aliases).map(|&[id, smaller]| (id, smaller)).collect();
        let end = |&id: &i64| std::iter::successors(Some(id), |id| becomes.get(id).copied()).last().unwrap();
        prop_assert_eq!(carried.iter().map(end).collect::<Vec<_>>(), settled);
    }

    /// A history that is played back settles to the same ids, also with limits.
    #[test]
    fn a_replayed_history_settles_to_the_same_ids(script in script(), (limits, sort) in selections()) {
        let (mut weaver, evicted, twin) = weave(&script, 1)?;
        let mut replay = Replay::new(weaver.next_id() - 1).with_late_joins();
        let mut parts = Vec::new();
        for span in &evicted {
            let rows: Vec<[SegmentId; 2]> =
                span.segments.iter().map(|row| [row.segment_id, row.next_segment_id]).collect();
            let mut ids = span.raw_ids.clone();
            let settles_at = replay.part(&rows, &span.seedless, &mut ids).unwrap();
            parts.push((ids, settles_at));
        }
        replay.finish();
        let of_replay = Selection::new(replay.aliases(), limits, sort).unwrap();
        let of_weaver = Selection::new(weaver.aliases(), limits, sort).unwrap();
        let all = Selection::default();
        for (selection, expected) in [(&all, &all), (&of_replay, &of_weaver)] {
            let mut settling = replay.aliases().settling(selection);
            for ((ids, settles_at), span) in parts.iter().zip(&evicted).rev() {
                settling.rewind(replay.aliases(), *settles_at, |_, _| ()).unwrap();
                let (mut ids, mut of_span) = (ids.clone(), span.raw_ids.clone());
                settling.settle(&mut ids);
                weaver.aliases().resolve(&mut of_span, expected).unwrap();
                prop_assert_eq!(ids, of_span);
            }
        }
        let mut closed = Vec::new();
        replay.aliases().for_each_closed(|whole| closed.push(*whole)).unwrap();
        closed.sort_unstable_by_key(|whole| whole.id);
        prop_assert_eq!(closed, twin.wholes());
    }
}

/// Windows of more points than one thread takes at a time.
#[test]
fn threads_that_share_a_window_give_the_ids_of_one() {
    let script = Script {
        span_points: vec![30_000, 70_001, 0, 45_000, 99_999, 1, 64_000],
        size: WindowSize::new(3, 2).unwrap(),
        labels: (0..99_991i64).map(|i| if i % 7 == 0 { NONE } else { i * i % 1_013 / 2 }).collect(),
        seedless: 3,
        disagree: 5,
        late: vec![],
    };
    let agrees = |from, label| script.agrees(from, label);
    let woven = |threads| {
        let (mut weaver, crew, mut evicted) = (Weaver::default(), Crew::new(threads).unwrap(), Vec::new());
        script.play(|index, first_span, span_points, labels| {
            let seeded: Vec<bool> = (0..labels.count() as i32).map(|label| script.is_seeded(index, label)).collect();
            let (seeded, agrees) = (Some(&seeded[..]), Some(&agrees as &Agreement<'_>));
            let window = LabelledWindow { index, first_span, span_points, labels, seeded, agrees };
            evicted.extend(weaver.weave(&window, &crew));
        });
        evicted.extend(weaver.finish());
        (evicted, closed(&mut weaver))
    };
    let one = woven(1);
    assert!(one.0.iter().flat_map(|span| &span.segments).any(|row: &SegmentRow| row.shared_points > 1));
    assert!((2..5).all(|threads| woven(threads) == one));
}

/// More segments than memory remembers, some of which are joined long after they have gone.
#[test]
fn a_long_history_with_late_joins_is_replayed() {
    let (parts, births) = (150, 1000);
    let mut replay = Replay::new(parts * births).with_late_joins();
    for part in 0..parts {
        let ids = part * births + 1..=(part + 1) * births;
        let mut rows: Vec<[SegmentId; 2]> = ids.clone().map(|id| [id, NONE]).collect();
        // A segment of the first part, and the first of this.
        rows.extend((part > 0).then_some([part, *ids.start()]));
        replay.part(&rows, &[], &mut ids.collect::<Vec<_>>()).unwrap();
    }
    replay.finish();
    let mut ids: Vec<SegmentId> = (1..parts).map(|part| part * births + 1).collect();
    replay.aliases().resolve(&mut ids, &Selection::default()).unwrap();
    assert_eq!(ids, (1..parts).collect::<Vec<_>>());
}

/// Found by `aliases_make_carried_ids_final`: 3 has been handed out and becomes 2, which has not; when 2 becomes 1,
/// whoever keeps the ids needs to know that too.
#[test]
fn an_alias_to_an_id_that_was_never_handed_out_is_continued() {
    let mut carry = Carry::default();
    carry.extend(3, true);
    carry.hand_out(3, 1);
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
