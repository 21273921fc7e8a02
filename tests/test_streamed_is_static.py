"""Streamed equals static: with lengths on the map and in space, whatever the cut and source."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from decimal import Decimal
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference import segmentor as twin
from reference.clouds import LatticeCloud
from reference.consumer import in_order
from reference.partition import same

CSITE3 = "isprs/CSite3.laz"
WIDTHS = [5.0, 10.0, 25.0, 50.0, 100.0]
FLAT = ss.Proximity(0.6, metric="xy")


@pytest.fixture(scope="module")
def flat_csite3(cloud: Callable[[str], LatticeCloud]) -> NDArray[np.int64]:
    """The 2-D radius graph of the paper's cloud."""
    _, points, scale = cloud(CSITE3)
    return twin.radius(points, 0.6, scale)


@pytest.fixture(scope="module")
def static_csite3(data: Path) -> NDArray[np.int64]:
    return ss.segment_static(data / CSITE3, ss.Proximity(2.5))


def test_on_the_map_static_is_the_radius_graph(data: Path, flat_csite3: NDArray[np.int64]) -> None:
    labels = ss.segment_static(data / CSITE3, FLAT)
    assert len(np.unique(labels)) == 118_133
    assert same(labels, flat_csite3)


@pytest.mark.parametrize("direction", ["x", "y", 30.0])
@pytest.mark.parametrize("width", WIDTHS)
def test_on_the_map_streamed_is_static(
    data: Path, flat_csite3: NDArray[np.int64], width: float, direction: str | float
) -> None:
    labels = ss.segment(data / CSITE3, FLAT, spans=ss.SpanByWidth(width, direction))
    assert len(np.unique(labels)) == 118_133
    assert same(labels, flat_csite3)


@pytest.mark.parametrize(
    ("name", "distance", "widths"),
    [
        ("als/hawaii_pass.laz", 0.4, [2.0, 40.0]),
        ("als/delft_ahn3.laz", 0.3, [0.3, 7.0]),
        ("mls/amsterdam_street.laz", 0.05, [0.25, 3.0]),
    ],
)
def test_on_the_map_other_clouds_too(
    cloud: Callable[[str], LatticeCloud], name: str, distance: float, widths: list[float]
) -> None:
    path, points, scale = cloud(name)
    expected = twin.radius(points, distance, scale)
    print(f"{name} at {distance}: {expected.max() + 1} segments")
    for width, direction in zip(widths, ("x", "y"), strict=True):
        labels = ss.segment(path, ss.Proximity(distance, metric="xy"), spans=ss.SpanByWidth(width, direction))
        assert same(labels, expected)


@pytest.mark.parametrize("direction", ["x", "y", 30.0])
@pytest.mark.parametrize("width", WIDTHS)
def test_in_space_streamed_is_static_and_proves_it(
    data: Path, static_csite3: NDArray[np.int64], width: float, direction: str | float
) -> None:
    with ss.stream(data / CSITE3, ss.Proximity(2.5), spans=ss.SpanByWidth(width, direction), result="carry") as run:
        spans = list(run)
        carried = run.resolve(np.concatenate([span.segment_ids for span in spans]))
    labels = in_order([span.point_ids for span in spans], [carried])
    assert same(labels, static_csite3)
    assert run.is_identical
    assert run.certificate.is_complete


@pytest.mark.filterwarnings("ignore:not one scan line ends")
@pytest.mark.parametrize("spans", [ss.SpanByCount(20_000), ss.SpanByTime(0.5), ss.SpanByScanLine(40)], ids=repr)
def test_spans_in_stream_order_reach_every_point_once(data: Path, spans: object) -> None:
    path = data / "als" / "mixed_conifer.laz"
    with ss.stream(path, ss.Proximity(1.0, metric="xy"), spans=spans) as run:
        point_ids = np.concatenate([span.point_ids for span in run])
    assert np.array_equal(point_ids, np.arange(37_657))


def small_cloud(seed: int, count: int = 400) -> NDArray[np.float64]:
    """Whole numbers, so that exact distances, equal places and points on the borders of slabs abound."""
    return np.random.default_rng(seed).integers(0, 60, (count, 3)).astype(float)


def write_las(path: Path, points: NDArray[np.float64]) -> Path:
    las = laspy.create(point_format=1, file_version="1.2")
    las.header.scales, las.header.offsets = np.full(3, 0.01), np.array([100.0, -200.0, 0.0])
    las.x, las.y, las.z = points.T
    las.gps_time = np.arange(len(points)) / 100
    las.write(str(path))
    return path


clouds = st.builds(small_cloud, st.integers(0, 10**6), st.integers(0, 300))
# Where the whole numbers lie: real coordinates of a lattice far from zero are not exact any more.
places = st.sampled_from([(1.0, 0.0), (0.01, 5_400_000.0), (0.001, -0.5), (0.25, 1e9)])
windows = st.tuples(st.integers(1, 5), st.integers(1, 4)).filter(lambda w: w[1] < w[0]).map(lambda w: ss.Window(*w))
directions = st.one_of(st.sampled_from(["x", "y"]), st.floats(0, 360))


@given(clouds, places, windows, directions, st.sampled_from([2, 3, 5]), st.floats(1.01, 9), st.integers(1, 4))
def test_any_cut_on_the_map(
    points: NDArray[np.float64],
    place: tuple[float, float],
    window: ss.Window,
    direction: str | float,
    distance: int,
    factor: float,
    threads: int,
) -> None:
    scale, offset = place
    reach = float(Decimal(str(scale)) * distance)
    spans = ss.SpanByWidth(factor * reach / window.overlap, direction)
    segmentor = ss.Proximity(reach, metric="xy")
    labels = ss.segment(points * scale + offset, segmentor, spans=spans, window=window, threads=threads)
    assert same(labels, twin.radius(points.astype(np.int64), distance))


@pytest.mark.parametrize("window", [ss.Window(2, 1), ss.Window(3, 1), ss.Window(5, 2), ss.Window(6, 4)], ids=repr)
@pytest.mark.parametrize("distance", [2, 3])
def test_on_a_lattice_an_overlap_as_wide_as_the_distance_will_do(
    tmp_path: Path, window: ss.Window, distance: int
) -> None:
    points = small_cloud(100 + distance)
    path = write_las(tmp_path / "lattice.las", points)
    expected = twin.radius(points.astype(np.int64), float(distance))
    for direction in ("x", "y"):
        spans = ss.SpanByWidth(distance / window.overlap, direction)
        assert same(ss.segment(path, ss.Proximity(distance, metric="xy"), spans=spans, window=window), expected)


@given(clouds, st.randoms(use_true_random=False), st.floats(2.01, 30))
def test_any_order_of_the_points(points: NDArray[np.float64], random: object, width: float) -> None:
    order = np.array(random.sample(range(len(points)), len(points)), np.int64)  # type: ignore[attr-defined]
    segmentor = ss.Proximity(2.0, metric="xy")
    labels = ss.segment(points, segmentor, spans=ss.SpanByWidth(width))
    assert same(ss.segment(points[order], segmentor, spans=ss.SpanByWidth(width)), labels[order])


@given(clouds, st.lists(st.integers(0, 300), max_size=8), st.sampled_from(["list", "generator"]))
def test_any_chunks(points: NDArray[np.float64], cuts: list[int], kind: str) -> None:
    # A sorted cloud, so that a generator of it is a live source that spans by width can follow.
    points = points[np.argsort(points[:, 0], kind="stable")]
    chunks = np.split(points, sorted(cuts))
    for spans in (ss.SpanByWidth(7.0), ss.SpanByCount(23)):
        source = list(chunks) if kind == "list" else iter(chunks)
        labels = ss.segment(source, ss.Proximity(2.0), spans=spans)
        assert np.array_equal(labels, ss.segment(points, ss.Proximity(2.0), spans=spans))


def kinds_of_source(points: NDArray[np.float64], folder: Path) -> Iterator[tuple[str, object]]:
    half = len(points) // 2
    yield "array", points
    yield "list", points.tolist()
    yield "float32", points.astype(np.float32)
    yield "integers", points.astype(np.int32)
    yield "big endian", points.astype(">f8")
    yield "Fortran order", np.asfortranarray(points)
    yield "every other row", np.repeat(points, 2, axis=0)[::2]
    yield "columns of a wider array", np.hstack([points, points])[:, 3:]
    yield "backwards in memory", points[::-1].copy()[::-1]
    yield "read-only", np.frombuffer(points.tobytes()).reshape(-1, 3)
    yield "list of arrays", [points[:half], points[half:]]
    yield "tuple of arrays", (points[:half], np.asfortranarray(points[half:]))
    yield "tuples with attributes", [(points[:half], {"gps_time": np.arange(half)}), (points[half:], {})]
    yield "generator", (chunk for chunk in np.array_split(points, 7))
    yield "generator of lists", (chunk.tolist() for chunk in np.array_split(points, 7))
    yield "path", write_las(folder / "all.las", points)
    yield "str", str(write_las(folder / "all.laz", points))
    yield "several files", [write_las(folder / "a.laz", points[:half]), write_las(folder / "b.laz", points[half:])]
    np.save(folder / "all.npy", points)
    yield "npy", folder / "all.npy"


def test_sources_of_every_kind_are_the_same_cloud(tmp_path: Path) -> None:
    # Whole numbers that float32 holds, on so fine a lattice that there are no ties among triangulations.
    points = np.random.default_rng(8).integers(0, 60_000, (1000, 3)).astype(float)
    points = points[np.argsort(points[:, 0], kind="stable")]
    for spans in (ss.SpanByWidth(6000.0), ss.SpanByCount(100)):
        expected = ss.segment(points, ss.Proximity(4000.0), spans=spans)
        assert 20 < len(np.unique(expected)) < 900
        for kind, source in kinds_of_source(points, tmp_path):
            assert np.array_equal(ss.segment(source, ss.Proximity(4000.0), spans=spans), expected), kind
    expected = ss.segment_static(points, ss.Proximity(4000.0))
    for kind, source in kinds_of_source(points, tmp_path):
        assert np.array_equal(ss.segment_static(source, ss.Proximity(4000.0)), expected), kind


def test_attributes_of_arrays_and_of_live_items_cut_by_time(tmp_path: Path) -> None:
    points = small_cloud(10, 1000)
    time = np.arange(1000) / 100
    spans = ss.SpanByTime(1.0)
    items = [(points[i : i + 90], {"gps_time": time[i : i + 90]}) for i in range(0, 1000, 90)]
    file = write_las(tmp_path / "timed.laz", points)
    expected = ss.segment(points, FLAT, spans=ss.SpanByCount(100))
    assert np.array_equal(ss.segment(points, FLAT, spans=spans, attributes={"gps_time": time}), expected)
    assert np.array_equal(ss.segment(iter(items), FLAT, spans=spans), expected)
    assert np.array_equal(ss.segment(file, FLAT, spans=spans), expected)


@pytest.mark.parametrize("spans", [ss.SpanByWidth(10.0), ss.SpanByCount(30_000)], ids=repr)
def test_ids_do_not_depend_on_the_number_of_threads(data: Path, spans: object) -> None:
    def run(threads: int) -> tuple[NDArray[np.int64], ...]:
        with ss.stream(data / CSITE3, ss.Proximity(2.5), spans=spans, threads=threads) as stream:
            taken = list(stream)
        return tuple(
            np.concatenate([getattr(span, name) for span in taken]) for name in ("point_ids", "segment_ids", "aliases")
        )

    one, *others = (run(threads) for threads in (1, 2, 4))
    for other in others:
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_the_size_of_chunks_does_not_matter(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = data / "als" / "chablais3.laz"
    spans = ss.SpanByWidth(4.0)
    expected = ss.segment(path, ss.Proximity(0.4), spans=spans)
    for size in (777, 10_000):
        monkeypatch.setattr("streamseg.source._CHUNK", size)
        assert np.array_equal(ss.segment(path, ss.Proximity(0.4), spans=spans), expected)


def test_what_a_run_promises_of_itself() -> None:
    points = small_cloud(1)

    def promise(segmentor: object, spans: object) -> tuple[str, bool]:
        run = ss.stream(points, segmentor, spans=spans)
        return run.exactness, run.is_identical

    assert promise(FLAT, ss.SpanByWidth(5.0)) == ("A", True)
    assert promise(FLAT, None) == ("A", True)
    assert promise(FLAT, ss.SpanByCount(50)) == ("A", False)
    assert promise(ss.Proximity(0.6), ss.SpanByWidth(5.0)) == ("B", True)
    assert promise(ss.Proximity(0.6), ss.SpanByCount(50)) == ("C", False)
    assert promise(lambda window: np.zeros(len(window), int), ss.SpanByWidth(5.0)) == ("C", False)
