//! Models of the look-up tables, checked in every order in which threads can interleave and loads can be answered.
//!
//! Run with `RUSTFLAGS="--cfg loom" cargo test --release --test weaver_model`; all orders are tried, which takes seconds.
//! Larger models can be bounded with `LOOM_MAX_PREEMPTIONS=3`.
#![cfg(loom)]
#![allow(clippy::unwrap_used)]

use loom::sync::Arc;
use loom::thread;
use streamseg::label::Cause;
use streamseg::weaver::{Inserted, Pairs, PointSegment};

/// A table with so many points, none of which has a segment yet.
fn table_of(points: usize) -> PointSegment {
    let mut table = PointSegment::with_capacity(points);
    table.extend(points);
    table
}

#[test]
fn of_two_threads_with_one_point_one_wins_and_the_other_is_told_its_id() {
    loom::model(|| {
        let table = Arc::new(table_of(1));
        let other = Arc::clone(&table);
        let other = thread::spawn(move || other.insert_if_absent(0, 8));
        let mine = table.insert_if_absent(0, 7);
        let theirs = other.join().unwrap();
        let winner = match (mine, theirs) {
            (Inserted::New, Inserted::Kept(kept)) => {
                assert_eq!(kept, 7);
                7
            }
            (Inserted::Kept(kept), Inserted::New) => {
                assert_eq!(kept, 8);
                8
            }
            both => panic!("{both:?}"),
        };
        assert_eq!(table.get(0), Some(winner));
    });
}

#[test]
fn of_three_threads_with_one_point_one_wins() {
    loom::model(|| {
        let table = Arc::new(table_of(1));
        let others = [8, 9].map(|id| {
            let table = Arc::clone(&table);
            thread::spawn(move || (id, table.insert_if_absent(0, id)))
        });
        let mut answers = vec![(7, table.insert_if_absent(0, 7))];
        answers.extend(others.map(|other| other.join().unwrap()));
        let winner = table.get(0).unwrap();
        for (id, answer) in answers {
            assert_eq!(answer, if id == winner { Inserted::New } else { Inserted::Kept(winner) });
        }
    });
}

#[test]
fn a_segment_beats_any_cause_and_of_two_causes_the_earlier_stays() {
    for is_labelled in [true, false] {
        loom::model(move || {
            let table = Arc::new(table_of(1));
            let others = [Cause::Filtered, Cause::Noise].map(|cause| {
                let table = Arc::clone(&table);
                thread::spawn(move || table.explain(0, cause))
            });
            if is_labelled {
                assert_eq!(table.insert_if_absent(0, 7), Inserted::New);
                assert_eq!(table.get(0), Some(7), "no cause takes its place");
            } else {
                assert_eq!(table.get(0), None);
            }
            others.map(|other| other.join().unwrap());
            assert_eq!(table.find(0), if is_labelled { Ok(7) } else { Err(Cause::Noise) });
        });
    }
}

#[test]
fn a_reader_sees_an_insertion_whole_or_not_at_all_and_never_undone() {
    loom::model(|| {
        const LARGE: i64 = (1 << 55) + (1 << 31) + 5;
        let table = Arc::new(table_of(1));
        let writer = Arc::clone(&table);
        let writer = thread::spawn(move || writer.insert_if_absent(0, LARGE));
        let seen = [table.get(0), table.get(0)];
        assert_eq!(writer.join().unwrap(), Inserted::New);
        assert!([[None, None], [None, Some(LARGE)], [Some(LARGE), Some(LARGE)]].contains(&seen), "{seen:?}");
        assert_eq!(table.get(0), Some(LARGE));
    });
}

#[test]
fn a_reader_of_an_evicted_point_never_sees_the_point_that_took_its_place() {
    loom::model(|| {
        // The ring has one word; arrival 1 takes the word of arrival 0.
        let table = table_of(1);
        table.insert_if_absent(0, 7);
        let table = Arc::new(table);
        let writer = Arc::clone(&table);
        let writer = thread::spawn(move || {
            writer.evict_before(1);
            writer.insert_if_absent(1, 9)
        });
        let (old, new, old_after_new) = (table.get(0), table.get(1), table.get(0));
        assert_eq!(writer.join().unwrap(), Inserted::New);
        assert!([None, Some(7)].contains(&old), "{old:?}");
        assert!([None, Some(9)].contains(&new), "{new:?}");
        assert!(new.is_none() || old_after_new.is_none(), "its place is taken");
        assert_eq!((table.get(0), table.get(1)), (None, Some(9)));
    });
}

#[test]
fn a_word_that_is_reused_twice_over_belongs_to_its_last_point() {
    loom::model(|| {
        let table = table_of(1);
        table.insert_if_absent(0, 7);
        let table = Arc::new(table);
        let evicting = Arc::clone(&table);
        let evicting = thread::spawn(move || {
            for arrival in [1, 2] {
                evicting.evict_before(arrival);
                assert_eq!(evicting.insert_if_absent(arrival, 10 + arrival as i64), Inserted::New);
            }
        });
        let reading = Arc::clone(&table);
        let reading = thread::spawn(move || reading.get(1));
        let (first, second) = (table.get(0), reading.join().unwrap());
        evicting.join().unwrap();
        assert!([None, Some(7)].contains(&first), "{first:?}");
        assert!([None, Some(11)].contains(&second), "{second:?}");
        assert_eq!(table.get(2), Some(12));
    });
}

/// Takes the table out of its `Arc`, whose other owners are gone.
fn sole<T>(shared: Arc<T>) -> T {
    Arc::try_unwrap(shared).ok().expect("all threads have been joined")
}

/// Counts `adds` on one thread each, in a table that they fill as far as it may be.
fn counted(adds: &[Vec<(i64, i32, u64)>]) -> Vec<(i64, i32, u64)> {
    let pairs = Arc::new(Pairs::new(1, adds.iter().map(Vec::len).sum()));
    let threads: Vec<_> = adds[1..]
        .iter()
        .cloned()
        .map(|adds| {
            let pairs = Arc::clone(&pairs);
            thread::spawn(move || adds.iter().for_each(|&(from, label, points)| pairs.add(from, label, points)))
        })
        .collect();
    adds[0].iter().for_each(|&(from, label, points)| pairs.add(from, label, points));
    threads.into_iter().for_each(|thread| thread.join().unwrap());
    sole(pairs).seal()
}

#[test]
fn one_pair_added_by_two_threads_has_one_place_and_the_sum() {
    loom::model(|| assert_eq!(counted(&[vec![(3, 1, 5)], vec![(3, 1, 7)]]), [(3, 1, 12)]));
}

#[test]
fn one_pair_added_by_three_threads_has_one_place_and_the_sum() {
    loom::model(|| assert_eq!(counted(&[vec![(3, 1, 5)], vec![(3, 1, 7)], vec![(3, 1, 9)]]), [(3, 1, 21)]));
}

#[test]
fn different_pairs_in_a_table_of_four_places_keep_their_counts() {
    // Of five pairs in four places two collide at least; every two of them are tried against each other.
    for (a, b) in (0..5).flat_map(|a| (0..a).map(move |b| (a, b))) {
        loom::model(move || {
            let [a, b] = [a, b].map(|pair| (1 + pair / 2, (pair % 2) as i32, 1 << pair));
            let mut expected = [a, b];
            expected.sort_unstable();
            assert_eq!(counted(&[vec![a], vec![b]]), expected);
        });
    }
}

#[test]
fn pairs_that_share_some_of_their_keys_add_up() {
    loom::model(|| {
        let counted = counted(&[vec![(1, 0, 1), (2, 1, 2)], vec![(2, 1, 4), (1, 0, 8)]]);
        assert_eq!(counted, [(1, 0, 9), (2, 1, 6)]);
    });
}

/// Two threads weave overlapping stretches of one window, as the weaver would if stretches could overlap: each looks its
/// points up, adds the new ones and notes a pair for those that were there.
#[test]
fn two_threads_that_weave_one_window_leave_what_one_would() {
    loom::model(|| {
        // Points 0 and 1 are in segments 1 and 2 of the window before; point 2 is new. The window's segments are 3 and 4.
        const LABELS: [i32; 3] = [0, 1, 1];
        let table = table_of(3);
        table.insert_if_absent(0, 1);
        table.insert_if_absent(1, 2);
        let shared = Arc::new((table, Pairs::new(1, 3)));
        let weave = |(table, pairs): &(PointSegment, Pairs), points: std::ops::Range<usize>| {
            for point in points {
                if let Inserted::Kept(from) = table.insert_if_absent(point as u64, 3 + i64::from(LABELS[point])) {
                    pairs.add(from, LABELS[point], 1);
                }
            }
        };
        let other = Arc::clone(&shared);
        let other = thread::spawn(move || weave(&other, 1..3));
        weave(&shared, 0..2);
        other.join().unwrap();
        let (table, pairs) = sole(shared);
        assert_eq!([0, 1, 2].map(|point| table.get(point)), [Some(1), Some(2), Some(4)]);
        // Both threads looked point 1 up.
        assert_eq!(pairs.seal(), [(1, 0, 1), (2, 1, 2)]);
    });
}

/// Sizes are counted when points go out of scope, from what the table then says: once for each point, whoever labelled it.
#[test]
fn points_that_two_threads_label_count_once_and_disagreeing_segments_are_no_pair() {
    loom::model(|| {
        let table = table_of(2);
        table.insert_if_absent(0, 1);
        let shared = Arc::new((table, Pairs::new(1, 4)));
        let weave = |(table, pairs): &(PointSegment, Pairs), label: i32| {
            for point in 0..2 {
                if let Inserted::Kept(from) = table.insert_if_absent(point, 2 + i64::from(label)) {
                    pairs.add(from, label, 1);
                }
            }
        };
        let other = Arc::clone(&shared);
        let other = thread::spawn(move || weave(&other, 1));
        weave(&shared, 0);
        other.join().unwrap();
        let (table, pairs) = sole(shared);
        let (first, second) = (table.get(0), table.get(1));
        assert_eq!(first, Some(1));
        let mut sealed = pairs.seal();
        // Who came second with point 1 has met the other.
        let met = if second == Some(2) { (2, 1, 1) } else { (3, 0, 1) };
        assert_eq!(sealed, [(1, 0, 1), (1, 1, 1), met]);
        sealed.retain(|&(from, label, _)| from != 1 || label != 0);
        assert_eq!(sealed, [(1, 1, 1), met]);
        table.evict_before(2);
        assert_eq!(table.live(), 0);
    });
}

/// A thread that still reads the points of a span while another lets it go and weaves the next window into its place.
#[test]
fn handing_a_span_out_while_the_next_window_is_woven_mixes_nothing() {
    loom::model(|| {
        let table = table_of(2);
        table.insert_if_absent(0, 1);
        table.insert_if_absent(1, 2);
        let shared = Arc::new((table, Pairs::new(1, 2)));
        let weaving = Arc::clone(&shared);
        let weaving = thread::spawn(move || {
            let (table, pairs) = &*weaving;
            table.evict_before(1);
            if let Inserted::Kept(from) = table.insert_if_absent(1, 3) {
                pairs.add(from, 0, 1);
            }
            assert_eq!(table.insert_if_absent(2, 3), Inserted::New);
        });
        let handed_out = [0, 1].map(|point| shared.0.get(point));
        weaving.join().unwrap();
        assert!([None, Some(1)].contains(&handed_out[0]), "{handed_out:?}");
        assert_eq!(handed_out[1], Some(2));
        let (table, pairs) = sole(shared);
        assert_eq!([0, 1, 2].map(|point| table.get(point)), [None, Some(2), Some(3)]);
        assert_eq!(pairs.seal(), [(2, 0, 1)]);
    });
}
