"""Limits of size and order by size: of final ids only, the same in every way that leads to them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from typer.testing import CliRunner

import streamseg as ss
from reference import history
from reference.clouds import LatticeCloud
from reference.consumer import in_order
from reference.partition import same
from reference.scripts import Script, scripts
from reference.sizes import Limits
from reference.weaver import NONE, final_ids, sizes
from streamseg.cli import app
from streamseg.description import describe

Ids = NDArray[np.int64]

limits = st.builds(
    lambda least, more, sort: Limits(least, None if more is None else least + more, sort),
    st.integers(1, 6),
    st.none() | st.integers(0, 6),
    st.sampled_from(["native", "ascending", "descending"]),
)
# Two points that are apart in the first two windows and together in the third.
LATE = Script([2, 2, 2, 2], ss.Window(2, 1), [0, 1, 0, 1, 2, 0, 0, 0, 0, 1, 0])


def taken(run: ss.Stream) -> Ids:
    spans = list(run)
    return in_order([span.point_ids for span in spans], [span.segment_ids for span in spans])


def resolved(folder: Path, **options: bool) -> Ids:
    parts = list(ss.History(folder).resolve(**options))
    return in_order([points for points, _ in parts], [ids for _, ids in parts])


def assert_results_agree(source: Any, segmentor: Any, asked: Limits, folder: Path, **options: Any) -> Ids:
    """All results, with limits and without; returns the final ids without."""
    with ss.stream(source, segmentor, **options) as plain:
        carried = taken(plain)
    final = plain.resolve(carried)
    assert plain.left_out == (0, 0)
    selected = asked.select(final)
    with asked.of_every_run():
        with ss.stream(source, segmentor, result="final", history=folder / "final", **options) as run:
            assert np.array_equal(taken(run), selected), "final ids"
        assert run.left_out == asked.left_out(final)
        assert run.progress.segments == len(np.unique(selected[selected != -1]))
        raw = history.raw_ids(folder / "final")
        for ids in (raw, carried, final):
            assert np.array_equal(run.resolve(ids), final), "small ones are retrievable"
            assert np.array_equal(run.resolve(ids, limits=True), selected), "limits of any ids"
        assert np.array_equal(resolved(folder / "final"), selected), "the history applies the limits"
        assert np.array_equal(resolved(folder / "final", limits=False), final), "the history keeps everything"
        assert np.array_equal(ss.segment(source, segmentor, **options), selected)
    with asked._replace(sort="native").of_every_run():
        for result, untouched in (("carry", carried), ("history", raw)):
            with ss.stream(source, segmentor, result=result, history=folder / result, **options) as run:
                assert np.array_equal(taken(run), untouched), result
            assert run.left_out == (0, 0)
            assert np.array_equal(run.resolve(untouched, limits=True), asked._replace(sort="native").select(final))
            assert np.array_equal(resolved(folder / result), asked._replace(sort="native").select(final))
    return final


@given(scripts, limits)
@example(LATE, Limits(3, None, "descending"))
def test_results_agree_on_anything_a_segmentor_says(script: Script, asked: Limits) -> None:
    with TemporaryDirectory() as folder:
        assert_results_agree(script.spans(), script.segmentor(), asked, Path(folder), window=script.window)


@given(scripts, limits)
@example(LATE, Limits(2, 4, "ascending"))
def test_sizes_are_those_of_the_twin(script: Script, asked: Limits) -> None:
    twin, _ = script.weave()
    final = final_ids((row.segment_id, row.next_segment_id) for row in twin.segment_segment_file)
    size = sizes(twin.point_segment_file, final)
    most = float("inf") if asked.max_segment_size is None else asked.max_segment_size
    order = {"native": lambda i: i, "ascending": lambda i: (size[i], i), "descending": lambda i: (-size[i], i)}
    kept = sorted((i for i in size if asked.min_segment_size <= size[i] <= most), key=order[asked.sort])
    number = {segment: segment if asked.sort == "native" else place for place, segment in enumerate(kept, start=1)}
    wholes = [final.get(twin.point_segment_file.get(point, NONE), NONE) for point in range(sum(script.span_points))]

    segmentor: Any = script.segmentor()
    segmentor.min_segment_size, segmentor.max_segment_size, segmentor.sort = asked
    labels = ss.segment(script.spans(), segmentor, window=script.window)
    assert labels.tolist() == [number.get(whole, NONE) for whole in wholes]


@given(st.integers(0, 1 << 32), st.sampled_from([1.6, 3.0, 10.0]), st.sampled_from([(2, 1), (3, 1), (4, 3)]), limits)
def test_results_agree_on_random_clouds(seed: int, width: float, window: tuple[int, int], asked: Limits) -> None:
    random = np.random.default_rng(seed)
    points = random.integers(0, [40, 20, 3], (random.integers(1, 150), 3)).astype(float)
    options: dict[str, Any] = {"spans": ss.SpanByWidth(width), "window": ss.Window(*window)}
    segmentor = ss.Proximity(1.5, metric="xy")
    with TemporaryDirectory() as folder:
        final = assert_results_agree(points, segmentor, asked, Path(folder), threads=1, **options)
    with asked.of_every_run():
        threaded = ss.segment(points, segmentor, threads=3, **options)
        assert np.array_equal(threaded, asked.select(final)), "any number of threads"
        static = ss.segment_static(points, segmentor)
        assert same(threaded, static)
        if asked.sort != "native":
            largest = np.bincount(static[static != -1], minlength=1)[1:]
            assert np.array_equal(largest, np.bincount(threaded[threaded != -1], minlength=1)[1:])


@pytest.mark.parametrize(
    ("name", "distance", "width", "asked"),
    [
        ("als/mixed_conifer.laz", 1.0, 5.0, Limits(3, 500, "native")),
        ("isprs/CSite3.laz", 2.0, 4.0, Limits(10, None, "descending")),
    ],
)
def test_results_agree_on_measured_clouds(
    cloud: Callable[[str], LatticeCloud], tmp_path: Path, name: str, distance: float, width: float, asked: Limits
) -> None:
    path, _, _ = cloud(name)
    final = assert_results_agree(path, ss.Proximity(distance), asked, tmp_path, spans=ss.SpanByWidth(width))
    segments, points = asked.left_out(final)
    print(f"{name}: {len(np.unique(final))} segments, {segments} of {points} points left out by {asked}")
    assert segments > 0


def test_segments_of_no_size_are_the_whole_story_of_an_empty_cloud() -> None:
    with Limits(5, 9, "descending").of_every_run():
        assert ss.segment(np.empty((0, 3)), ss.Proximity(1.0)).shape == (0,)
        with ss.stream([], ss.Proximity(1.0), result="final") as run:
            assert list(run) == []
        assert run.left_out == (0, 0)


@pytest.mark.parametrize("least", [40, 60])
def test_a_stopped_stream_knows_the_sizes_of_what_has_come(least: int) -> None:
    class Enough(Exception):
        pass

    def on_progress(progress: ss.Progress) -> None:
        if progress.windows == 2 and not run.progress_told:
            run.progress_told = True
            raise Enough

    row = (np.column_stack([10.0 * index + np.arange(10), np.zeros((10, 2))]) for index in range(100))
    with Limits(least).of_every_run():
        run: Any = ss.stream(row, ss.Proximity(1.0), result="final", on_progress=on_progress)
        run.progress_told = False
        with pytest.raises(Enough):
            next(run)
        run.stop()
        ids = taken(run)
    assert ids.tolist() == [1 if least <= 50 else -1] * 50


def test_an_interrupt_after_settling_numbers_nothing_twice() -> None:
    points = np.repeat(np.arange(12.0), np.arange(12, 0, -1))[:, None] * [10, 0, 0]

    def profile(_: FrameType, event: str, called: Any) -> None:
        if event == "c_return" and called.__name__ == "settle":
            sys.setprofile(None)
            raise KeyboardInterrupt

    with Limits(3, None, "ascending").of_every_run():
        run = ss.stream(points, ss.Proximity(1.0), result="final")
        sys.setprofile(profile)
        with pytest.raises(KeyboardInterrupt):
            next(run)
        ids = taken(run)
    assert np.array_equal(ids, Limits(3, None, "ascending").select(ss.segment(points, ss.Proximity(1.0))))
    assert run.left_out == (2, 3)


def test_limits_are_not_known_before_the_end() -> None:
    run = ss.stream((np.zeros((3, 3)) for _ in range(9)), ss.Proximity(1.0))
    next(run)
    with pytest.raises(ss.InvalidParameter, match="limits is True before the stream has ended"):
        run.resolve([1], limits=True)
    list(run)
    assert run.resolve([1, -1], limits=True).tolist() == [1, -1]


@pytest.mark.parametrize("result", ["carry", "history"])
def test_an_order_needs_final_ids(result: Any) -> None:
    message = f"sort is 'descending' with result='{result}', allowed: with result='final'"
    with pytest.raises(ss.InvalidParameter, match=message):
        ss.stream(np.zeros((3, 3)), ss.Proximity(1.0, sort="descending"), result=result)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (Limits(0), "min_segment_size is 0, allowed: a whole number of at least 1"),
        (Limits(-3), "min_segment_size is -3, allowed: a whole number of at least 1"),
        (Limits(5, 4), "max_segment_size is 4 with a min_segment_size of 5, allowed: at least min_segment_size"),
        (Limits(1, -1), "max_segment_size is -1, allowed: a whole number of at least 1"),
        (Limits(sort="up"), "sort is 'up', allowed: 'native', 'ascending' or 'descending'"),
    ],
)
def test_limits_that_cannot_be_are_refused(asked: Limits, message: str) -> None:
    with asked.of_every_run(), pytest.raises(ss.InvalidParameter, match=message):
        ss.segment(np.zeros((3, 3)), ss.Proximity(1.0))


def test_from_file_to_file_and_back_from_the_history(tmp_path: Path) -> None:
    points = np.repeat(np.arange(12.0), np.arange(1, 13))[:, None] * [10, 0, 0]
    np.save(tmp_path / "in.npy", points)
    asked = Limits(4, 9)
    with asked.of_every_run():
        outcome = ss.segment_file(
            tmp_path / "in.npy", tmp_path / "out.npy", ss.Proximity(1.0), history=tmp_path / "run"
        )
    assert dict(describe(tmp_path / "run"))["sizes"] == "4 to 9 points, in native order"
    assert (outcome.segments, outcome.left_out) == (6, ss.LeftOut(6, 1 + 2 + 3 + 10 + 11 + 12))
    final = ss.segment(points, ss.Proximity(1.0))
    assert len(np.unique(final)) == 12
    assert np.array_equal(np.load(tmp_path / "out.npy"), asked.select(final))
    for limits, expected in ((True, asked.select(final)), (False, final)):
        ss.resolve_file(tmp_path / "run", tmp_path / "in.npy", tmp_path / "again.npy", limits=limits, overwrite=True)
        assert np.array_equal(np.load(tmp_path / "again.npy"), expected)


def test_the_command_line_says_what_is_left_out(tmp_path: Path) -> None:
    np.save(tmp_path / "in.npy", np.repeat(np.arange(12.0), np.arange(1, 13))[:, None] * [10, 0, 0])
    files = [str(tmp_path / "in.npy"), str(tmp_path / "out.npy")]
    words = ["--distance", "1", "--min-size", "4", "--history", str(tmp_path / "run")]
    done = CliRunner().invoke(app, ["segment", *files, *words])
    assert "72 of 78 points in 9 segments, " in done.stdout
    assert "6 points have no segment (8 %): all in 3 segments smaller than 4 points\n" in done.stdout
    for option, kept in (("--limits", 9), ("--no-limits", 12)):
        CliRunner().invoke(app, ["resolve", str(tmp_path / "run"), *files, option, "--overwrite"])
        assert len(np.unique(np.load(tmp_path / "out.npy"))) - (option == "--limits") == kept
