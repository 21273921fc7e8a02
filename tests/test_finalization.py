"""Stored clouds in stream order: decisions wait until their region is final, and are then those of the whole cloud."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, overload

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference.consumer import ids_of
from reference.partition import agreement, same
from streamseg._core import Recipe, SlabCounts
from streamseg.finalization import slabs_for
from streamseg.source import open_source

Positions = NDArray[np.float64]
TILES = [f"als/lidarhd_{tile}.laz" for tile in ("77050_627755", "77050_627760", "77055_627755", "77055_627760")]
GROWING = ss.RegionGrowing(k=12, search_radius=1.0)


def finalized(source: Any, segmentor: Any, **options: Any) -> tuple[NDArray[np.int64], ss.Stream]:
    """Final ids of a run that waits, and the run; every point has to come out once."""
    with ss.stream(source, segmentor, revisit=True, result="final", **options) as run:
        return ids_of(run), run


@pytest.mark.parametrize(
    ("name", "segmentor", "spans"),
    [
        ("als/topography.laz", ss.Dbscan(3.0, 6), ss.SpanByTime(0.5)),
        ("als/topography.laz", ss.RegionGrowing(k=15, search_radius=4.0), ss.SpanByTime(0.5)),
        ("als/autzen_trim.laz", ss.Dbscan(2.0, 6), ss.SpanByScanLine(50)),
        ("als/autzen_trim.laz", ss.Proximity(2.0), ss.SpanByCount(10_000)),
        ("als/mixed_conifer.laz", ss.PlaneExtraction(1.5, tile_size=6.0), ss.SpanByCount(3_000)),
    ],
    ids=repr,
)
def test_a_file_in_stream_order_gives_the_static_partition(data: Path, name: str, segmentor: Any, spans: Any) -> None:
    static = ss.segment_static(data / name, segmentor)
    labels, run = finalized(data / name, segmentor, spans=spans)
    assert same(labels, static)
    assert (run.exactness, run.is_identical) == ("B", True)
    assert run.promise.endswith("decisions wait until their region is final")
    certificate = run.certificate
    print(f"{name}: {certificate.most_waiting / len(labels):.1%} wait at the most")
    assert certificate.is_complete
    assert 0 < certificate.waited_points <= len(labels)
    assert 0 < certificate.most_waiting < len(labels)


def test_strips_that_overlap_are_one(data: Path) -> None:
    # A part of a town flown over in several strips, which are one behind the other in the file.
    las = laspy.read(data / "als" / "delft_ahn3.laz")
    x, y = las.x - las.header.mins[0], las.y - las.header.mins[1]
    kept = (x < 100) & (y < 100)
    points, time = np.column_stack([las.x, las.y, las.z])[kept], np.asarray(las.gps_time)[kept]
    segmentor, spans = ss.Dbscan(0.6, 6), ss.SpanByTime(0.5)
    static = ss.segment_static(points, segmentor)
    labels, _ = finalized(points, segmentor, spans=spans, attributes={"gps_time": time})
    assert same(labels, static)
    split = ss.segment(points, segmentor, spans=spans, attributes={"gps_time": time})
    print(f"{static.max()} segments, without waiting {len(np.unique(split))}")
    assert len(np.unique(split)) > len(np.unique(static))


@pytest.mark.parametrize(
    ("order", "segmentor"), [((2, 0, 3, 1), ss.Dbscan(0.8, 10)), ((3, 1, 0, 2), GROWING)], ids=repr
)
def test_tiles_in_any_order_are_one(data: Path, order: tuple[int, ...], segmentor: Any) -> None:
    paths = [data / TILES[i] for i in order]
    labels, run = finalized(paths, segmentor, spans=ss.SpanByCount(20_000))
    assert run.certificate.most_waiting < len(labels)
    assert same(labels, ss.segment_static(paths, segmentor))


def test_spans_given_in_any_order_are_one(data: Path) -> None:
    las = laspy.read(data / "als" / "mixed_conifer.laz")
    points = np.column_stack([las.x, las.y, las.z])
    agreements: list[float] = []
    for seed in range(10):
        order = np.random.default_rng(seed).permutation(30)
        spans = [np.array_split(points, 30)[i] for i in order]
        segmentor = ss.Dbscan(0.8, 6) if seed else ss.RegionGrowing(k=8, search_radius=1.0)
        labels, run = finalized(spans, segmentor)
        assert same(labels, ss.segment_static(np.concatenate(spans), segmentor))
        assert run.certificate.waited_points > 0
        agreements.append(agreement(ss.segment(spans, segmentor), labels))
    print("adjusted Rand index without waiting:", *(f"{index:.3f}" for index in agreements))
    assert max(agreements) < 0.9


def test_what_comes_out_is_what_comes_by_width(data: Path) -> None:
    # The same slabs, so the same ids and the same proof.
    path = data / "als" / "topography.laz"
    segmentor = ss.Proximity(4.0)
    slabs, counts = slabs_for(open_source(path), Recipe(segmentor, [], [], False))
    assert counts is not None
    assert counts.points == 73_403
    labels, run = finalized(path, segmentor, spans=ss.SpanByCount(5_000))
    assert np.array_equal(labels, ss.segment(path, segmentor, spans=slabs))
    assert same(labels, ss.segment_static(path, segmentor))
    assert run.is_proven
    assert run.certificate.decided_edges > 100_000
    assert run.certificate.most_waiting <= counts.most_waiting


clouds = st.builds(
    lambda seed, count: np.random.default_rng(seed).integers(0, 60, (count, 3)).astype(float),
    st.integers(0, 10**6),
    st.integers(0, 300),
)


@given(clouds, st.lists(st.integers(0, 300), max_size=8), st.integers(1, 3), st.booleans())
def test_any_cloud_in_any_spans(points: Positions, cuts: list[int], threads: int, with_nan: bool) -> None:
    if with_nan:
        points[::7, 1] = np.nan
    options = {"drop_invalid": with_nan}
    static = ss.segment_static(points, ss.Dbscan(6.0, 4), **options)
    for source, spans in ((np.split(points, sorted(cuts)), None), (points, ss.SpanByCount(23))):
        labels = ss.segment(source, ss.Dbscan(6.0, 4), spans=spans, threads=threads, revisit=True, **options)
        assert same(labels, static)


def test_without_a_limit_all_wait_and_spans_are_by_width(tmp_path: Path) -> None:
    points = np.random.default_rng(3).random((1000, 3)) * [100, 40, 0]
    points[:, 2] = abs(points[:, 0] % 40 - 20)  # the sides of three roofs
    text = tmp_path / "cloud.xyz"
    np.savetxt(text, points)
    growing = ss.RegionGrowing(k=8)
    for source in (points, text, [points[:300], points[300:]]):
        labels, run = finalized(source, growing, spans=ss.SpanByCount(100))
        assert (run.exactness, run.is_identical, run.is_proven) == ("B", True, True)
        assert len(np.unique(labels)) > 3
        assert same(labels, ss.segment_static(source, growing))


def test_spans_by_width_need_no_waiting() -> None:
    points = np.random.default_rng(3).random((1000, 3)) * 100
    expected = ss.segment(points, ss.Dbscan(5.0), spans=ss.SpanByWidth(20.0))
    labels, run = finalized(points, ss.Dbscan(5.0), spans=ss.SpanByWidth(20.0))
    assert np.array_equal(labels, expected)
    assert run.certificate.waited_points == 0
    assert same(ss.segment(points, ss.Dbscan(5.0), revisit=True), expected)


def test_the_manifest_tells_who_waited_and_where(tmp_path: Path) -> None:
    points = np.random.default_rng(3).random((1000, 3)) * [10, 200, 0]
    with ss.stream(points, ss.Dbscan(1.0), spans=ss.SpanByCount(50), revisit=True, history=tmp_path / "past") as run:
        for _ in run:
            pass
    manifest = json.loads((tmp_path / "past" / "manifest.json").read_text())
    assert manifest["complete"] is True
    assert manifest["promise"] == run.promise
    assert manifest["parameters"]["revisit"] is True
    assert manifest["parameters"]["spans"] == "SpanByCount(50)"
    assert manifest["parameters"]["slabs"].startswith("SpanByWidth(20.0, direction=")
    assert manifest["certificate"]["waited_points"] == run.certificate.waited_points > 900
    assert manifest["certificate"]["most_waiting"] == run.certificate.most_waiting > 900


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_flight_line_waits_no_longer_than_it_must(axis: int, backward: bool) -> None:
    # 100 000 points along a line: of the slabs that are 20 m wide not even one waits.
    points = np.random.default_rng(3).random((100_000, 3)) * 20
    points[:, axis] += np.arange(100_000) / 100 * (-1 if backward else 1)
    slabs, counts = slabs_for(open_source(points), Recipe(ss.Dbscan(1.0), [], [], False))
    assert counts is not None
    assert slabs.direction == ("xy"[axis] if not backward else (270.0, 180.0)[axis])
    assert counts.most_waiting < 5_000


def test_a_damaged_file_is_read_up_to_the_damage(data: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.laz"
    raw = (data / "als" / "topography.laz").read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    with pytest.warns(ss.StreamsegWarning, match=r"cut.laz is damaged after point"):
        labels, _ = finalized(path, ss.Dbscan(3.0), spans=ss.SpanByCount(5_000))
    assert 10_000 < len(labels) < 73_403
    with pytest.warns(ss.StreamsegWarning):
        by_width = ss.segment(path, ss.Dbscan(3.0))
    assert same(labels, by_width)


class Feed(Sequence[Positions]):
    """Arrays that are others each time they are read."""

    def __init__(self, *readings: list[Positions]) -> None:
        self.readings = iter(readings)

    def __len__(self) -> int:
        return 1

    @overload
    def __getitem__(self, at: int) -> Positions: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[Positions]: ...
    def __getitem__(self, at: int | slice) -> Any:
        raise IndexError(at)

    def __iter__(self) -> Iterator[Positions]:
        return iter(next(self.readings))


WALK = [np.column_stack([np.arange(i, i + 50.0), np.zeros((50, 2))]) for i in range(0, 500, 50)]


@pytest.mark.parametrize(
    ("second", "told"),
    [
        (WALK[:7], r"it ended after 350 points, and 500 were counted"),
        ([*WALK, WALK[0]], r"where point 500 lies, fewer points were counted"),
        ([*WALK[:5], WALK[2] + [0, 0, 0], *WALK[6:]], r"where point 250 lies, fewer points were counted"),
        ([*WALK[:5], WALK[5] + 1e6, *WALK[6:]], r"where point 250 lies, fewer points were counted"),
        ([], r"it ended after 0 points, and 500 were counted"),
    ],
    ids=["shorter", "longer", "repeated", "elsewhere", "read once only"],
)
def test_a_source_that_changes_is_told_and_no_point_is_lost(second: list[Positions], told: str) -> None:
    # It is looked at once to see what it is.
    run = ss.stream(Feed(WALK, WALK, second), ss.Dbscan(1.0, 2), revisit=True, result="final", threads=1)
    taken: list[int] = []
    with pytest.raises(ss.InvalidInput, match=f"the source has changed since its points were counted: {told}; it has"):
        taken.extend(point for span in run for point in span.point_ids)
    come = 500 if "500 lies" in told else 300 if "250 lies" in told else sum(map(len, second))
    come += 50 * ("500 lies" in told)
    assert list(run) == []
    assert not taken or sorted(taken) == list(range(come))


def test_a_file_that_grows_meanwhile_is_told(tmp_path: Path) -> None:
    path = tmp_path / "growing.xyz"
    np.savetxt(path, np.concatenate(WALK))

    counter = itertools.count(1)

    def grow(_: object) -> None:
        # The first call is of the counting, the second one of the run.
        if next(counter) == 2:
            with path.open("a") as file:
                np.savetxt(file, WALK[0])

    with pytest.raises(ss.FileError, match=r"growing\.xyz has changed since it was opened"):
        ss.segment_file(
            path,
            tmp_path / "out.xyz",
            ss.Dbscan(1.0, 2),
            spans=ss.SpanByCount(40),
            revisit=True,
            on_progress=grow,
        )


def test_the_command_line_has_it_too(tmp_path: Path) -> None:
    points = np.random.default_rng(3).random((1000, 3)) * [100, 20, 0]
    np.savetxt(tmp_path / "in.xyz", points)
    command = "-m streamseg segment in.xyz out.xyz --method dbscan --eps 2 --span-count 100 --revisit"
    done = subprocess.run([sys.executable, *command.split()], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "decisions wait until their region is final" in done.stdout
    labels = np.loadtxt(tmp_path / "out.xyz")[:, 3]
    assert same(labels, ss.segment_static(tmp_path / "in.xyz", ss.Dbscan(2.0)))


@pytest.mark.parametrize("calls", [1, 2, 4, 30])
def test_an_interrupt_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calls: int) -> None:
    spool = tmp_path / "spool"
    spool.mkdir()
    monkeypatch.setenv("TMPDIR", str(spool))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("streamseg.source._CHUNK", 5_000)
    points = np.random.default_rng(1).random((20_000, 3)) * [400, 20, 1]
    np.save(tmp_path / "in.npy", points)
    counter = itertools.count(1)

    def interrupt(_: object) -> None:
        if next(counter) == calls:
            raise KeyboardInterrupt

    options: dict[str, Any] = {"spans": ss.SpanByCount(2_000), "revisit": True, "on_progress": interrupt}
    with pytest.raises(KeyboardInterrupt):
        ss.segment_file(tmp_path / "in.npy", tmp_path / "out.npy", ss.Dbscan(0.5), history=tmp_path / "past", **options)
    assert list(spool.iterdir()) == []
    if calls <= 4:
        # Still counting: nothing has been begun.
        assert {path.name for path in tmp_path.iterdir()} == {"in.npy", "spool"}


def test_counting_is_of_positions_only_and_refuses_what_the_run_would(data: Path) -> None:
    points = np.zeros((10, 3))
    points[4, 0] = np.nan
    with pytest.raises(ss.InvalidInput, match="point 4 has the coordinates"):
        ss.stream(points, ss.Dbscan(1.0), spans=ss.SpanByCount(3), revisit=True)
    with pytest.raises(ss.InvalidParameter, match="width is 0"):
        SlabCounts(iter([]), 0.0, lattice=None, drop_invalid=False, on_progress=None)
    names: list[tuple[str, ...]] = []
    source = open_source(data / "als" / "topography.laz")

    def chunks(wanted: Sequence[str]) -> Iterator[Any]:
        names.append(tuple(wanted))
        return source.chunks(wanted)

    listening = source._replace(chunks=chunks)
    list(ss.stream(listening, ss.Dbscan(3.0, filter="Intensity > 50"), spans=ss.SpanByTime(1.0), revisit=True))
    assert names == [(), ("gps_time", "intensity")]
