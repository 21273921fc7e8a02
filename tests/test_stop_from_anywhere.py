"""A stream is stopped or closed by any thread, callback or source, also while it is at work; nobody waits for it."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference import history

Positions = NDArray[np.float64]
NEAR = ss.Proximity(1.5)
# Nothing here takes seconds; who waits longer than this waits for ever.
LONG = 60


def row(index: int) -> Positions:
    return np.column_stack([np.arange(10.0) + 10 * index, np.zeros((10, 2))])


class Scanner:
    """Gives arrays without end, and before one of them waits until it is told to go on."""

    def __init__(self, waits_at: int) -> None:
        self.waits_at = waits_at
        self.reached, self.go_on = threading.Event(), threading.Event()
        self.given = 0

    def __iter__(self) -> Iterator[Positions]:
        while True:
            if self.given == self.waits_at:
                self.reached.set()
                assert self.go_on.wait(LONG)
            self.given += 1
            yield row(self.given - 1)


class Taker:
    """Takes all spans of a stream in a thread of its own."""

    def __init__(self, run: ss.Stream) -> None:
        self.taken: list[int] = []
        self.failure: BaseException | None = None
        self._thread = threading.Thread(target=self._take, args=(run,), daemon=True)
        self._thread.start()

    def _take(self, run: ss.Stream) -> None:
        try:
            for span in run:
                self.taken.append(span.index)
        except BaseException as failure:
            self.failure = failure

    def join(self) -> None:
        self._thread.join(LONG)
        assert not self._thread.is_alive()


ENDS: dict[str, Callable[[ss.Stream], object]] = {
    "stop": lambda run: run.stop(),
    "stop with patience": lambda run: run.stop(0.5),
    "close": lambda run: run.close(),
    "leave": lambda run: run.__exit__(None, None, None),
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("result", ["carry", "final"])
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("spans", [None, ss.SpanByCount(30), ss.SpanByCount(10**6)], ids=["given", "few", "one"])
def test_while_the_source_is_waited_for(tmp_path: Path, end: str, result: Any, threads: int, spans: Any) -> None:
    scanner = Scanner(waits_at=7)
    run = ss.stream(scanner, NEAR, spans=spans, threads=threads, result=result, history=tmp_path / "past")
    taker = Taker(run)
    assert scanner.reached.wait(LONG)
    ENDS[end](run)
    scanner.go_on.set()
    taker.join()
    assert taker.failure is None
    # The array that was waited for has come, and no more; all points come out.
    assert scanner.given == 8
    assert taker.taken == list(range({None: 8, 30: 3, 10**6: 1}[getattr(spans, "points", None)]))
    past = ss.History(tmp_path / "past")
    assert past.manifest["complete"] is False
    assert past.manifest["points"] == 80 == len(history.raw_ids(past.folder))
    assert not run.is_proven
    run.close()
    assert list(run) == []


def test_while_a_window_is_segmented() -> None:
    under_way, go_on = threading.Event(), threading.Event()

    def slow(window: ss.WindowPoints) -> NDArray[np.int64]:
        under_way.set()
        assert go_on.wait(LONG)
        return np.zeros(len(window), int)

    run = ss.stream(map(row, range(10**9)), slow)
    taker = Taker(run)
    assert under_way.wait(LONG)
    run.stop()
    go_on.set()
    taker.join()
    assert (taker.failure, taker.taken) == (None, [0, 1, 2])


def test_patience_ends_while_a_window_is_segmented() -> None:
    asked: list[ss.Stream] = []
    cloud = np.random.default_rng(0).random((200_000, 3))

    def ask(progress: ss.Progress) -> None:
        # It is called again and again while the window, which takes minutes, is waited for.
        if len(asked) > 20:
            run.stop(patience=0.0)
        asked.append(run)

    run = ss.stream(iter([cloud, cloud]), ss.RegionGrowing(60_000), threads=1, on_progress=ask)
    taker = Taker(run)
    taker.join()
    assert (taker.failure, taker.taken) == (None, [])


@pytest.mark.parametrize("end", ENDS)
def test_in_a_callback_and_in_the_source(tmp_path: Path, end: str) -> None:
    def source() -> Iterator[Positions]:
        for index in range(100):
            if index == 5:
                ENDS[end](run)
            yield row(index)

    run = ss.stream(source(), NEAR, history=tmp_path / "source")
    assert [span.index for span in run] == list(range(6))
    assert ss.History(tmp_path / "source").manifest["points"] == 60

    def callback(progress: ss.Progress) -> None:
        if progress.windows == 2:
            ENDS[end](run)

    run = ss.stream(map(row, range(100)), NEAR, on_progress=callback, history=tmp_path / "callback")
    taken = [span.index for span in run]
    assert 5 <= len(taken) < 10
    assert taken == list(range(len(taken)))
    assert ss.History(tmp_path / "callback").manifest["points"] == 10 * len(taken)


def test_closing_between_two_spans_writes_the_rest_and_ends_the_taker(tmp_path: Path) -> None:
    between, go_on = threading.Event(), threading.Event()
    run = ss.stream(map(row, range(10**9)), NEAR, history=tmp_path / "past")
    taken: list[int] = []

    def take() -> None:
        for span in run:
            taken.append(span.index)
            between.set()
            assert go_on.wait(LONG)

    thread = threading.Thread(target=take, daemon=True)
    thread.start()
    assert between.wait(LONG)
    run.close()
    past = ss.History(tmp_path / "past")
    assert past.manifest["points"] == len(history.raw_ids(past.folder)) > 10
    go_on.set()
    thread.join(LONG)
    assert not thread.is_alive()
    assert taken == [0]


def test_a_look_at_the_progress_disturbs_nobody() -> None:
    run = ss.stream(map(row, range(3000)), NEAR)
    taker = Taker(run)
    looks = 0
    while len(taker.taken) < 3000 and taker.failure is None:
        with contextlib.suppress(ss.StreamInUse):
            looks += run.progress.points >= 0
    taker.join()
    assert taker.failure is None
    assert looks


def test_a_run_that_has_ended_stays_complete(tmp_path: Path) -> None:
    run = ss.stream(map(row, range(9)), NEAR, history=tmp_path / "past")
    assert len(list(run)) == 9
    run.stop()
    run.close()
    assert ss.History(tmp_path / "past").manifest["complete"] is True
    assert run.is_proven is ss.stream([row(0)], NEAR).is_identical


@pytest.mark.parametrize("patience", [-1, -0.001, float("nan"), float("-inf"), np.float64("nan"), -(10**400)])
def test_a_patience_that_is_none_is_refused(patience: Any) -> None:
    with (
        ss.stream(np.zeros((5, 3)), ss.Proximity(1.0)) as stream,
        pytest.raises(ss.InvalidParameter, match="allowed: 0 or more seconds, or None"),
    ):
        stream.stop(patience)


@pytest.mark.parametrize("patience", ["1", b"1", True, [1], 1j, np.array([1.0])])
def test_a_patience_that_is_no_number_is_refused(patience: Any) -> None:
    with (
        ss.stream(np.zeros((5, 3)), ss.Proximity(1.0)) as stream,
        pytest.raises(ss.InvalidType, match=r"patience is .*, allowed: a number of seconds, or None"),
    ):
        stream.stop(patience)


@pytest.mark.parametrize("patience", [None, 1e300, float("inf"), 10**400, np.float32(60), np.int64(60)])
def test_a_long_patience_gives_nothing_up(patience: Any) -> None:
    with ss.stream(np.zeros((5, 3)), ss.Proximity(1.0)) as stream:
        span = next(stream)
        stream.stop(patience)
        assert len(span) == 5
        assert list(stream) == []
