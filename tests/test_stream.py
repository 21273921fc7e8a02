"""Manners of the iterator: live and endless sources, early exits, several at once, memory."""

from __future__ import annotations

import gc
import itertools
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference import history
from reference.consumer import take

Positions = NDArray[np.float64]


class Road:
    """An endless row of points, ten to a span, which counts how many spans it has been asked for."""

    def __init__(self, spans: int | None = None) -> None:
        self.asked = 0
        self.ended = False
        self._spans = spans

    def __iter__(self) -> Iterator[Positions]:
        try:
            for index in itertools.count() if self._spans is None else range(self._spans):
                self.asked += 1
                yield self.span(index)
        finally:
            self.ended = True

    @staticmethod
    def span(index: int) -> Positions:
        # Two rows that stay apart, and in every span a heap of its own.
        x = 10.0 * index + np.arange(5)
        rows = np.concatenate([np.column_stack([x, np.zeros((5, 2))]), np.column_stack([x, np.full((5, 2), 40.0)])])
        return np.concatenate([rows, [[10.0 * index + 2, 20.0, 0.0]]])


NEAR = ss.Proximity(6.5)


@pytest.mark.parametrize("result", ["carry", "history", "final"])
@pytest.mark.parametrize("spans", [0, 1, 2, 7])
def test_exhausted_stays_exhausted(result: Any, spans: int) -> None:
    run = ss.stream(Road(spans), NEAR, result=result)
    assert iter(run) is run
    assert [span.index for span in run] == list(range(spans))
    for _ in range(3):
        with pytest.raises(StopIteration):
            next(run)


@pytest.mark.parametrize("window", [ss.Window(1, 0), ss.Window(2, 1), ss.Window(3, 1), ss.Window(5, 3)], ids=repr)
@pytest.mark.filterwarnings("ignore:windows share no span")
def test_labels_come_out_as_soon_as_no_window_can_change_them(window: ss.Window) -> None:
    road = Road()
    with ss.stream(road, NEAR, window=window) as run:
        assert road.asked == 0
        for span in itertools.islice(run, 20):
            # Span i goes out when a window has been woven in which, and in the one before which, it is not.
            past = span.index // window.advance + 1
            assert road.asked == (past + 1) * window.advance + window.spans


@pytest.mark.parametrize("threads", [2, 3])
def test_each_further_thread_reads_at_most_a_window_ahead(threads: int) -> None:
    road, window = Road(), ss.Window(3, 1)
    with ss.stream(road, NEAR, window=window, threads=threads) as run:
        for span in itertools.islice(run, 20):
            past = span.index // window.advance + 1
            assert road.asked <= (past + threads) * window.advance + window.spans


def test_an_endless_stream_holds_no_more_after_300_spans_than_after_10() -> None:
    road = Road()
    with ss.stream(road, NEAR) as run:
        entries = [run.live_entries for _ in itertools.islice(run, 400)]
        woven = run.progress
    # Two windows of three spans that share one: five spans of eleven points and three segments a window.
    assert max(points for points, _ in entries) == 5 * 11
    assert max(segments for _, segments in entries) == max(segments for _, segments in entries[:10])
    assert woven.points >= 400 * 11
    assert woven.segment_ids > 400
    assert woven.live_segments == entries[-1][1]
    assert woven.weaving > 0


def test_ids_of_an_endless_stream_are_carried_on() -> None:
    with ss.stream(Road(), NEAR) as run:
        for span in itertools.islice(run, 300):
            near, far, heap = np.split(span.segment_ids, [5, 10])
            assert np.unique(near).tolist() == [1]
            assert np.unique(far).tolist() == [2]
            assert heap not in (1, 2)


@pytest.mark.parametrize("stop_after", [0, 1, 2, 3, 8])
@pytest.mark.parametrize("threads", [1, 3])
def test_an_endless_stream_stopped_at_any_time_is_written_and_closed(
    tmp_path: Path, stop_after: int, threads: int
) -> None:
    road = Road()
    with ss.stream(road, NEAR, history=tmp_path / "run", threads=threads) as run:
        for _ in itertools.islice(run, stop_after):
            pass
    past = ss.History(tmp_path / "run")
    assert past.manifest["complete"] is False
    assert past.manifest["points"] == 11 * road.asked == len(history.raw_ids(past.folder))
    final = np.concatenate([ids for _, ids in past.resolve()])
    expected = ss.segment([road.span(i) for i in range(road.asked)], NEAR)
    assert np.array_equal(final, expected)
    assert list(run) == []


def test_a_closed_stream_lets_go_of_its_source() -> None:
    road = Road()
    with ss.stream(road, NEAR) as run:
        next(run)
    del run
    gc.collect()
    assert road.ended


def test_a_closed_stream_gives_nothing_more() -> None:
    with ss.stream(Road(), NEAR) as run:
        next(run)
    assert list(run) == []
    run.close()
    assert list(run) == []


def test_stop_lets_what_has_come_come_out() -> None:
    road = Road()
    with ss.stream(road, NEAR) as run:
        next(run)
        asked = road.asked
        run.stop()
        assert [span.index for span in run] == list(range(1, asked))
    assert road.asked == asked


def test_two_streams_at_once_are_independent() -> None:
    expected = [span.segment_ids.tolist() for span in ss.stream(Road(30), NEAR)]
    first, second = ss.stream(Road(30), NEAR), ss.stream(Road(30), NEAR, threads=2)
    taken: list[list[Any]] = [[], []]
    for a, b in zip(first, second, strict=True):
        taken[0].append(a.segment_ids.tolist())
        taken[1].append(b.segment_ids.tolist())
    assert taken == [expected, expected]


def test_streams_in_threads_of_their_own_do_not_disturb_each_other() -> None:
    expected = [span.segment_ids.tolist() for span in ss.stream(Road(200), NEAR)]
    taken: dict[int, list[Any]] = {}

    def run(number: int) -> None:
        taken[number] = [span.segment_ids.tolist() for span in ss.stream(Road(200), NEAR, threads=1 + number % 2)]

    threads = [threading.Thread(target=run, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert taken == dict.fromkeys(range(4), expected)


def test_a_stream_can_be_handed_to_another_thread() -> None:
    run = ss.stream(Road(20), NEAR)
    taken = [next(run).index]
    thread = threading.Thread(target=lambda: taken.extend(span.index for span in run))
    thread.start()
    thread.join()
    assert taken == list(range(20))


BUSY = "the stream is at work already, in another thread or in its own source"


def test_a_source_that_takes_spans_of_its_own_stream_is_told_so(tmp_path: Path) -> None:
    answers: list[str] = []

    def source() -> Iterator[Positions]:
        for index in range(9):
            if index == 5:
                with pytest.raises(ss.StreamsegError) as caught:
                    next(run)
                answers.append(str(caught.value))
            yield Road.span(index)

    run = ss.stream(source(), NEAR, history=tmp_path / "run")
    assert [span.index for span in run] == list(range(9))
    assert len(answers) == 1
    assert BUSY in answers[0]
    # The refusal has done no harm.
    assert ss.History(tmp_path / "run").manifest["complete"] is True
    assert len(history.raw_ids(tmp_path / "run")) == 9 * 11


def test_two_threads_at_one_stream_are_told_so_and_do_no_harm(tmp_path: Path) -> None:
    reached, go_on = threading.Event(), threading.Event()

    def source() -> Iterator[Positions]:
        for index in range(9):
            if index == 4:
                reached.set()
                assert go_on.wait(60)
            yield Road.span(index)

    run = ss.stream(source(), NEAR, history=tmp_path / "run")
    taken: list[int] = []
    thread = threading.Thread(target=lambda: taken.extend(span.index for span in run))
    thread.start()
    assert reached.wait(60)
    for call in (lambda: next(run), lambda: run.progress, lambda: run.resolve([1]), lambda: run.live_entries):
        with pytest.raises(ss.StreamsegError, match=BUSY):
            call()
    go_on.set()
    thread.join()
    assert taken == list(range(9))
    assert len(history.raw_ids(tmp_path / "run")) == 9 * 11


def test_a_source_that_fails_costs_nothing_that_came_before(tmp_path: Path) -> None:
    def source() -> Iterator[Positions]:
        yield from (Road.span(index) for index in range(8))
        raise ConnectionError("the scanner is gone")

    for result in ("carry", "history", "final"):
        indices: list[int] = []
        run = ss.stream(source(), NEAR, result=result, history=tmp_path / result)  # type: ignore[arg-type]
        with pytest.raises(ConnectionError, match="the scanner is gone"):
            take(run, indices)
        assert indices == list(range(8))
        assert list(run) == []
        past = ss.History(tmp_path / result)
        assert past.manifest["complete"] is False
        assert len(history.raw_ids(past.folder)) == 8 * 11


def test_an_exception_in_the_body_leaves_the_history_readable(tmp_path: Path) -> None:
    road = Road(50)

    def body() -> None:
        with ss.stream(road, NEAR, history=tmp_path / "run", result="history") as run:
            for span in run:
                1 / (span.index - 4)

    with pytest.raises(ZeroDivisionError):
        body()
    past = ss.History(tmp_path / "run")
    assert past.manifest["complete"] is False
    assert past.manifest["points"] == 11 * road.asked == len(history.raw_ids(past.folder))


def test_on_progress_is_told_of_every_window() -> None:
    told: list[ss.Progress] = []
    with ss.stream(Road(21), NEAR, on_progress=told.append) as run:
        taken = list(run)
    assert len(taken) == 21
    assert {progress.windows for progress in told} == set(range(11))
    assert all(a.windows <= b.windows and a.points <= b.points for a, b in itertools.pairwise(told))
    assert run.progress.points == 21 * 11
    assert run.progress.windows == 10
    assert run.progress.live_segments == 0


@pytest.mark.parametrize("result", ["carry", "history", "final"])
def test_an_exception_of_on_progress_interrupts_and_the_run_goes_on(tmp_path: Path, result: Any) -> None:
    class Enough(Exception):
        pass

    told: list[int] = []

    def on_progress(progress: ss.Progress) -> None:
        told.append(progress.windows)
        if progress.windows == 4 and told.count(4) == 1:
            raise Enough

    run = ss.stream(Road(21), NEAR, on_progress=on_progress, history=tmp_path / "run", result=result)
    indices: list[int] = []
    with pytest.raises(Enough):
        take(run, indices)
    indices += [span.index for span in run]
    assert indices == list(range(21))
    assert len(history.raw_ids(tmp_path / "run")) == 21 * 11


def test_resolve_while_the_stream_runs_and_after() -> None:
    arms = [np.array([[float(x), y, 0.0] for y in (0.0, 5.0)]) for x in range(20)]
    bottom = np.array([[20.0, y, 0.0] for y in range(6)])
    run = ss.stream([*arms, bottom], ss.Proximity(1.0))
    assert next(run).segment_ids.tolist() == [1, 2]
    assert run.resolve([2, 1, -1]).tolist() == [2, 1, -1]
    list(run)
    assert run.resolve([2, 1, -1]).tolist() == [1, 1, -1]
    assert run.resolve([]).tolist() == []


def test_spans_can_be_compared() -> None:
    first, again = next(ss.stream(Road(9), NEAR)), next(ss.stream(Road(9), NEAR))
    assert first == first
    assert isinstance(first == again, bool)


def test_arrays_of_a_span_are_the_consumers_and_its_points_are_not() -> None:
    span, other = itertools.islice(ss.stream(Road(9), NEAR), 2)
    assert span.points is span.points
    with pytest.raises(ValueError, match="read-only"):
        span.points[0] = 0
    span.segment_ids[:] = 99
    assert 99 not in other.segment_ids
    assert span.segment_ids.dtype == span.point_ids.dtype == span.aliases.dtype == np.int64
