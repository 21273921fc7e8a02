"""Ctrl-C: answered within a window, and what has come is not lost, whether the run then goes on or is closed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference import history
from reference.consumer import take

Positions = NDArray[np.float64]
PER_SPAN = 20


def spans_of(count: int) -> list[Positions]:
    points = np.column_stack([np.arange(count * PER_SPAN), np.zeros((count * PER_SPAN, 2))])
    return np.split(points.astype(float), count)


def press_ctrl_c() -> None:
    """As the terminal does it: the signal is noted, and raised when the interpreter next looks."""
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("result", ["carry", "history", "final"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_signal_that_the_core_sees_ends_no_run(tmp_path: Path, threads: int, result: Any) -> None:
    # on_progress is called by the core between windows; an interrupt in it is one that the core has seen.
    pressed: list[int] = []

    def on_progress(progress: ss.Progress) -> None:
        if progress.windows == 5 and not pressed:
            pressed.append(progress.windows)
            press_ctrl_c()

    source = spans_of(31)
    run = ss.stream(
        source, ss.Proximity(1.5), threads=threads, result=result, on_progress=on_progress, history=tmp_path
    )
    indices: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        take(run, indices)
    assert run.progress.windows == 5
    indices += [span.index for span in run]
    assert indices == list(range(31))
    assert ss.History(tmp_path).manifest["complete"] is True
    assert len(history.raw_ids(tmp_path)) == 31 * PER_SPAN


@pytest.mark.parametrize("threads", [1, 2])
def test_a_run_closed_after_a_signal_has_written_all_that_had_come(tmp_path: Path, threads: int) -> None:
    asked: list[int] = []

    def source() -> Iterator[Positions]:
        for index, span in enumerate(spans_of(400)):
            asked.append(index)
            yield span

    def on_progress(progress: ss.Progress) -> None:
        if progress.windows == 5 and not pressed:
            pressed.append(True)
            press_ctrl_c()

    pressed: list[bool] = []
    with (
        pytest.raises(KeyboardInterrupt),
        ss.stream(source(), ss.Proximity(1.5), threads=threads, on_progress=on_progress, history=tmp_path) as run,
    ):
        for _ in run:
            pass
    past = ss.History(tmp_path)
    assert len(asked) < 30
    assert past.manifest["complete"] is False
    assert past.manifest["points"] == PER_SPAN * len(asked) == len(history.raw_ids(tmp_path))


def test_a_signal_from_a_timer_is_answered_soon(tmp_path: Path) -> None:
    # It comes wherever it comes, so nothing is said here of the last points.
    random = np.random.default_rng(2)
    asked: list[int] = []

    def source() -> Iterator[Positions]:
        for index in range(10_000):
            asked.append(index)
            if index == 6:
                timer.start()
            yield random.random((40_000, 3)) * [10, 100, 10] + [10.0 * index, 0, 0]

    timer = threading.Timer(0.05, press_ctrl_c)
    with (
        pytest.raises(KeyboardInterrupt),
        ss.stream(source(), ss.Proximity(0.3), spans=ss.SpanByCount(40_000), history=tmp_path) as run,
    ):
        for _ in run:
            pass
    timer.join()
    past = ss.History(tmp_path)
    assert 6 < len(asked) < 10_000
    assert past.manifest["complete"] is False
    point_ids = np.concatenate([points for points, _ in past.resolve()])
    assert len(np.unique(point_ids)) == len(point_ids) >= 40_000


def interrupt_at(nth: int, counted: list[str]) -> Callable[[FrameType, str, Any], None]:
    """A profile function that interrupts streamseg.stream when the nth call into compiled code has returned.

    This is where the interpreter raises a signal that has come during the call.
    """

    def profile(frame: FrameType, event: str, called: Any) -> None:
        if event == "c_return" and frame.f_globals.get("__name__") == "streamseg.stream":
            counted.append(called.__name__)
            if len(counted) == nth:
                raise KeyboardInterrupt

    return profile


@pytest.mark.parametrize("goes_on", [True, False], ids=["goes on", "is closed"])
def test_a_signal_between_the_core_and_the_history_loses_no_span(tmp_path: Path, goes_on: bool) -> None:
    source, nth, interrupted = spans_of(9), 0, True
    lost: dict[str, int] = {}
    while interrupted:
        nth += 1
        folder = tmp_path / str(nth)
        run = ss.stream(source, ss.Proximity(1.5), spans=ss.SpanByCount(PER_SPAN), threads=1, history=folder)
        counted: list[str] = []
        taken: list[int] = []
        sys.setprofile(interrupt_at(nth, counted))
        try:
            take(run, taken)
            interrupted = False
        except KeyboardInterrupt:
            pass
        finally:
            sys.setprofile(None)
        if goes_on:
            list(run)
        run.close()
        written = history.table(folder, "point_segment")[:, 0] if any(folder.glob("point_segment/*")) else np.empty(0)
        least = PER_SPAN * (9 if goes_on else len(taken))
        if not (np.array_equal(written, np.arange(len(written))) and len(written) >= least):
            lost[f"{nth}, after {counted[-1]}"] = len(written)
    assert nth > 9
    assert lost == {}


def test_a_signal_inside_the_source_ends_it_and_the_history_says_so(tmp_path: Path) -> None:
    def source() -> Iterator[Positions]:
        yield from spans_of(8)
        raise KeyboardInterrupt

    run = ss.stream(source(), ss.Proximity(1.5), history=tmp_path)
    indices: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        take(run, indices)
    assert indices == list(range(8))
    assert list(run) == []
    past = ss.History(tmp_path)
    assert past.manifest["complete"] is False
    assert len(history.raw_ids(tmp_path)) == 8 * PER_SPAN


def test_a_signal_inside_a_segmentor_in_python_ends_the_run_and_the_history_says_so(tmp_path: Path) -> None:
    def segmentor(window: ss.WindowPoints) -> Positions:
        if window.index == 3:
            raise KeyboardInterrupt
        return np.zeros(len(window), int)

    run = ss.stream(spans_of(31), segmentor, spans=ss.SpanByCount(PER_SPAN), history=tmp_path)
    indices: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        take(run, indices)
    assert indices == list(range(7))
    assert list(run) == []
    assert ss.History(tmp_path).manifest["complete"] is False


def test_stopping_by_hand_is_not_completing(tmp_path: Path) -> None:
    run = ss.stream(spans_of(31), ss.Proximity(1.5), history=tmp_path)
    next(run)
    run.stop()
    taken = 1 + len(list(run))
    past = ss.History(tmp_path)
    assert taken < 31
    assert past.manifest["points"] == PER_SPAN * taken
    assert past.manifest["complete"] is False


@pytest.mark.parametrize("name", ["out.laz", "out.npy"])
def test_what_is_segmented_is_written_even_if_that_is_when_ctrl_c_comes(tmp_path: Path, name: str) -> None:
    source = ss.scenes.write(tmp_path / "in.laz", "airborne", 300_000)
    pressed: list[int] = []

    def press(points: int) -> None:
        if not pressed:
            pressed.append(points)
            press_ctrl_c()

    with pytest.raises(KeyboardInterrupt):
        ss.segment_file(source, tmp_path / name, ss.Proximity(1.0), on_write=press)
    assert pressed
    expected = ss.segment(source, ss.Proximity(1.0))
    written = np.load(tmp_path / name) if name.endswith("npy") else np.array(laspy.read(tmp_path / name)["SegmentID"])
    assert np.array_equal(written, expected)


def test_a_second_ctrl_c_ends_the_writing_and_says_so(tmp_path: Path) -> None:
    source = ss.scenes.write(tmp_path / "in.laz", "airborne", 300_000)

    def press(_: int) -> None:
        press_ctrl_c()

    with pytest.raises(KeyboardInterrupt, match=r"^it was interrupted while it was being written$"):
        ss.segment_file(source, tmp_path / "out.laz", ss.Proximity(1.0), on_write=press)
    assert [path.name for path in tmp_path.iterdir()] == ["in.laz"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


INTERRUPTED_SOURCE = """
import numpy as np, streamseg as ss

def source():
    random = np.random.default_rng(0)
    for _ in range(3):
        yield random.random((100_000, 3))
    raise KeyboardInterrupt

try:
    list(ss.stream(source(), ss.RegionGrowing(90_000), threads=2))
except KeyboardInterrupt:
    print("heard")
"""


def test_an_interrupt_inside_the_source_waits_for_no_window_that_takes_minutes() -> None:
    told = subprocess.run([sys.executable, "-c", INTERRUPTED_SOURCE], capture_output=True, text=True, timeout=300)
    assert told.stdout == "heard\n", told.stderr
