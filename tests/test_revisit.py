"""Streams that come back to where they were: in any order of spans the same object is found once."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference import history
from reference.clouds import read
from reference.consumer import ids_of, take
from reference.partition import refines, same

Positions = NDArray[np.float64]

TILES = [f"als/lidarhd_770{row}_6277{column}.laz" for row in (50, 55) for column in (55, 60)]
RADIUS = ss.Proximity(0.8, graph="radius")
FLAT = ss.Proximity(0.5, metric="xy")


def segments(labels: NDArray[np.int64]) -> int:
    return len(np.unique(labels[labels >= 0]))


@pytest.fixture(scope="module")
def tiles(data: Path) -> Positions:
    """Every eighth point of four adjoining tiles, tile by tile, each in the order of its strips."""
    clouds = [read(data / tile) for tile in TILES]
    return np.concatenate([cloud.points[::8] * cloud.scale for cloud in clouds])


def order_of(points: Positions, seed: int, per_span: int) -> list[NDArray[np.int64]]:
    spans = np.split(np.arange(len(points)), np.arange(per_span, len(points), per_span))
    return [spans[i] for i in np.random.default_rng(seed).permutation(len(spans))]


def shuffled(points: Positions, seed: int, per_span: int = 1500) -> list[Positions]:
    """The cloud in spans of so many points, in random order."""
    return [points[span] for span in order_of(points, seed, per_span)]


@pytest.mark.parametrize("segmentor", [RADIUS, FLAT], ids=["radius", "xy"])
def test_ten_random_orders_of_spans_give_the_static_partition(tiles: Positions, segmentor: ss.Proximity) -> None:
    whole = ss.segment_static(tiles, segmentor)
    for seed in range(10):
        order = order_of(tiles, seed, 1500)
        spans, static = [tiles[span] for span in order], whole[np.concatenate(order)]
        back = ss.segment(iter(spans), segmentor, revisit=True)
        without = ss.segment(iter(spans), segmentor)
        print(f"order {seed}: {segments(back):,} segments, {segments(without):,} without revisit")
        assert same(back, static)
        assert refines(without, static)
        assert not same(without, static)


# The last ones never come back to where they were.
CUTS = [
    ("als/chablais3.laz", ss.Proximity(0.5, graph="radius"), ss.SpanByCount(2000), True),
    ("als/chablais3.laz", ss.Proximity(0.5, metric="xy"), ss.SpanByTime(0.1), True),
    ("als/mixed_conifer.laz", ss.Proximity(0.5, metric="xy"), ss.SpanByCount(2000), True),
    ("als/topography.laz", ss.Proximity(1.0, graph="radius"), ss.SpanByTime(0.1), False),
    ("als/autzen_trim.laz", ss.Proximity(2.0, metric="xy"), ss.SpanByCount(3000), False),
]


@pytest.mark.parametrize(("name", "segmentor", "spans", "comes_back"), CUTS)
def test_a_file_in_stream_order_gives_the_static_partition(
    data: Path, tmp_path: Path, name: str, segmentor: ss.Proximity, spans: Any, comes_back: bool
) -> None:
    static = ss.segment_static(data / name, segmentor)
    with ss.stream(
        data / name, segmentor, spans=spans, revisit=True, result="final", history=tmp_path, threads=2
    ) as run:
        labels = ids_of(run)
    without = ss.segment(data / name, segmentor, spans=spans)
    print(f"{name}, {spans}: {segments(labels):,} segments, {segments(without):,} without revisit")
    assert same(labels, static)
    assert (segments(without) > segments(static)) is comes_back
    assert run.is_identical
    assert run.is_proven
    assert run.warning is None
    assert "in any order" in run.promise
    manifest = ss.History(tmp_path).manifest
    assert manifest["parameters"]["revisit"] is True
    assert manifest["certificate"]["returned_points"] == run.certificate.returned_points
    assert (run.certificate.returned_points > 0) is comes_back
    assert manifest["certificate"]["early_decisions"] == 0
    assert np.array_equal(history.final_ids(tmp_path), labels)
    assert history.table(tmp_path, "window")[:, 10].sum() == run.certificate.returned_points


def test_an_array_a_list_and_an_iterator_are_alike(tiles: Positions) -> None:
    spans = shuffled(tiles, 11)
    cloud = np.concatenate(spans)
    static = ss.segment_static(cloud, RADIUS)
    sources: list[tuple[Callable[[], Any], Any]] = [
        (lambda: cloud, ss.SpanByCount(1000)),
        (lambda: spans, None),
        (lambda: iter(spans), None),
        (lambda: iter(spans), ss.SpanByCount(777)),
    ]
    for source, by in sources:
        for window in (ss.Window(1, 0), ss.Window(4, 3)):
            assert same(ss.segment(source(), RADIUS, spans=by, window=window, revisit=True), static)


def test_carried_ids_and_aliases_tell_the_same(tiles: Positions) -> None:
    spans = shuffled(tiles, 12)
    static = ss.segment_static(np.concatenate(spans), RADIUS)
    with ss.stream(iter(spans), RADIUS, revisit=True) as run:
        carried = np.concatenate([span.segment_ids for span in run])
    assert same(run.resolve(carried), static)


def test_where_later_points_undo_decisions_they_are_counted_as_early(tiles: Positions) -> None:
    spans = shuffled(tiles, 13)
    for segmentor in (ss.Dbscan(0.8, 5), ss.Proximity(0.8), ss.RegionGrowing(k=10, search_radius=1.0)):
        with ss.stream(iter(spans), segmentor, revisit=True) as run:
            ids = np.concatenate([span.segment_ids for span in run])
        assert len(ids) == len(tiles)
        assert run.certificate.early_decisions >= np.count_nonzero(ids >= 0) > 0
        assert run.certificate.returned_points > 0
        assert not run.is_identical
        assert not run.is_proven
        assert "early" in run.promise


def test_wide_spans_of_space_need_nothing_back(tiles: Positions) -> None:
    wide = ss.stream(tiles, RADIUS, spans=ss.SpanByWidth(10.0), revisit=True)
    assert len(list(wide)) > 1
    assert wide.certificate.returned_points == 0
    narrow = ss.stream(tiles, RADIUS, spans=ss.SpanByWidth(0.5), window=ss.Window(2, 1), revisit=True, result="final")
    labels = ids_of(narrow)
    assert narrow.certificate.returned_points > 0
    assert same(labels, ss.segment_static(tiles, RADIUS))


def test_a_segmentor_without_a_reach_is_refused() -> None:
    with pytest.raises(
        ss.InvalidParameter, match="revisit is true with a segmentor whose reach is not known, allowed: "
    ):
        ss.stream(iter([np.zeros((1, 3))]), lambda window: np.zeros(len(window)), revisit=True)


def test_attributes_come_back_with_the_points() -> None:
    criterion = ss.ConditionalClustering("abs(Intensity - n[0].Intensity) < 3", search_radius=1.0, min_segment_size=1)
    random = np.random.default_rng(5)
    points, intensity = random.random((3000, 3)) * [20, 20, 0], random.integers(0, 9, 3000).astype(float)
    items = [(points[i : i + 100], {"Intensity": intensity[i : i + 100]}) for i in range(0, 3000, 100)]
    back = ss.segment(iter(items), criterion, attributes=["Intensity"], revisit=True)
    assert same(back, ss.segment_static(points, criterion, attributes={"Intensity": intensity}))


@pytest.mark.parametrize("threads", [1, 3])
def test_an_interrupt_loses_no_point(tiles: Positions, threads: int) -> None:
    spans = shuffled(tiles, 14)
    pressed: list[int] = []

    def on_progress(progress: ss.Progress) -> None:
        if progress.windows == 4 and not pressed:
            pressed.append(4)
            raise KeyboardInterrupt

    run = ss.stream(iter(spans), RADIUS, revisit=True, threads=threads, on_progress=on_progress)
    indices: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        take(run, indices)
    indices += [span.index for span in run]
    assert indices == list(range(len(spans)))


ON_DISK = """
import os, resource, signal, sys
import numpy as np, streamseg as ss
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
random = np.random.default_rng(0)
strip = random.random((12_000, 3)) * [1000, 10, 0]
def strips():
    for i in range(50):
        if i == 45 and sys.argv[1] == "interrupt":
            raise KeyboardInterrupt
        yield strip + [0, 10 * i, 0]
run = ss.stream(strips(), ss.Proximity(1.0, graph="radius"), revisit=True)
if sys.argv[1] == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, resource.RLIM_INFINITY))
for _ in range(2):
    try:
        points = sum(len(span) for span in run)
        print("ended")
    except (ss.FileError, KeyboardInterrupt) as error:
        print(type(error).__name__, error)
    assert not os.listdir(os.environ["TMPDIR"]), os.listdir(os.environ["TMPDIR"])
print(os.listdir(os.environ["TMPDIR"]))
"""


@pytest.mark.parametrize("how", ["full", "interrupt", "whole"])
def test_the_store_leaves_no_file_and_tells_of_a_full_disk(tmp_path: Path, how: str) -> None:
    command = [sys.executable, "-c", ON_DISK, how]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    *told, left = done.stdout.splitlines()
    assert left == "[]"
    if how == "full":
        assert told[0].startswith(f"FileError the spool in {tmp_path} could not be written: ")
        assert told[0].endswith("free some space or set TMPDIR to another folder")
    if how == "interrupt":
        assert told[0].startswith("KeyboardInterrupt")
    assert told[-1] == "ended"


def test_the_command_line_comes_back_too(tiles: Positions, tmp_path: Path) -> None:
    cloud = np.concatenate(shuffled(tiles[::2], 15, 500))
    np.save(tmp_path / "in.npy", cloud)
    command = "segment in.npy out.npy --distance 1.5 --metric xy --span-count 700 --revisit"
    done = subprocess.run(
        [sys.executable, "-m", "streamseg", *command.split()], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    labels: NDArray[np.int64] = np.load(tmp_path / "out.npy")
    assert same(labels, ss.segment_static(cloud, ss.Proximity(1.5, metric="xy")))
    assert "in any order" in done.stdout + done.stderr
