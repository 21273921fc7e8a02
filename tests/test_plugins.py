"""Segmentors that a user brings: scikit-learn's objects and functions, with whatever they may return or raise."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN, HDBSCAN, AgglomerativeClustering, KMeans

import streamseg as ss
from reference.consumer import take
from reference.partition import agreement, same
from streamseg.cli.methods import segmentor as chosen

Positions = NDArray[np.float64]


def heaps(count: int = 12, each: int = 40) -> Positions:
    """Heaps of points along x, well apart, in the order in which a scanner would pass them."""
    random = np.random.default_rng(3)
    centers = np.column_stack([10.0 * np.arange(count), random.uniform(-3, 3, (count, 2))])
    points = np.repeat(centers, each, axis=0) + random.uniform(-1, 1, (count * each, 3))
    return points[np.argsort(points[:, 0])]


def by_heap(points: Positions) -> NDArray[np.int64]:
    return np.round(points[:, 0] / 10).astype(np.int64)


SKLEARN = [
    DBSCAN(eps=2.0, min_samples=3),
    HDBSCAN(min_cluster_size=10, copy=True),
    AgglomerativeClustering(n_clusters=None, distance_threshold=3.0, linkage="single"),
]


@pytest.mark.parametrize("segmentor", SKLEARN, ids=lambda segmentor: type(segmentor).__name__)
@pytest.mark.parametrize("threads", [1, 3])
def test_scikit_learn_finds_the_heaps_in_a_stream(segmentor: Any, threads: int) -> None:
    points = heaps()
    labels = ss.segment(points, segmentor, spans=ss.SpanByWidth(20.0), threads=threads)
    assert agreement(labels, by_heap(points)) > 0.99
    whole = ss.segment_static(points, segmentor)
    assert same(whole, segmentor.fit_predict(points))


def test_k_means_gives_as_many_segments_as_it_always_does() -> None:
    labels = ss.segment_static(heaps(), KMeans(n_clusters=7, n_init=1, random_state=0))
    assert np.unique(labels).tolist() == list(range(1, 8))


def test_noise_is_no_segment() -> None:
    points = np.vstack([heaps(3), [[500.0, 0, 0]]])
    labels = ss.segment(points, DBSCAN(eps=2.0, min_samples=3), spans=ss.SpanByCount(50))
    assert labels[-1] == -1
    assert labels[:-1].min() >= 1


def threshold(window: ss.WindowPoints) -> NDArray[np.int64]:
    return by_heap(window.points)


class Caller:
    def __call__(self, window: ss.WindowPoints) -> NDArray[np.int64]:
        return threshold(window)


class Fitter:
    def fit_predict(self, points: Positions) -> NDArray[np.int64]:
        return by_heap(points)


@pytest.mark.parametrize(
    "segmentor",
    [
        threshold,
        lambda window: by_heap(window.points).tolist(),
        lambda window: by_heap(window.points).astype(np.uint8),
        lambda window: by_heap(window.points).astype(">i2"),
        lambda window: 10**12 + by_heap(window.points),
        Caller(),
        Fitter(),
    ],
    ids=["function", "list", "uint8", "big-endian", "large", "callable object", "fit_predict"],
)
def test_labels_of_any_whole_type(segmentor: Any) -> None:
    points = heaps()
    assert same(ss.segment(points, segmentor, spans=ss.SpanByCount(60)), by_heap(points))


def test_bools_are_two_labels() -> None:
    points = heaps(2)
    assert np.unique(ss.segment_static(points, lambda window: window.points[:, 0] > 5)).tolist() == [1, 2]


def test_what_a_function_sees() -> None:
    points = heaps(6)
    points[[3, 100]] = np.nan
    seen: list[tuple[int, int, NDArray[np.int64], Positions]] = []

    def look(window: ss.WindowPoints) -> NDArray[np.int64]:
        seen.append((window.index, len(window), window.point_ids, window.points))
        assert not window.points.flags.writeable
        return np.zeros(len(window), int)

    labels = ss.segment(points, look, spans=ss.SpanByCount(50), drop_invalid=True)
    assert [index for index, *_ in seen] == [0, 1]
    for _, count, point_ids, positions in seen:
        assert count == len(point_ids) == len(positions)
        assert np.array_equal(positions, points[point_ids])
        assert not np.isin([3, 100], point_ids).any()
    assert np.flatnonzero(labels == -1).tolist() == [3, 100]


def test_a_window_without_points_asks_nobody() -> None:
    spans = [np.empty((0, 3))] * 4 + [np.zeros((2, 3))]
    calls: list[int] = []

    def count(window: ss.WindowPoints) -> list[int]:
        calls.append(len(window))
        return [0] * len(window)

    assert ss.segment(spans, count).tolist() == [1, 1]
    assert calls == [2]


def answering(answer: Callable[[int], Any], at: int = 2) -> Callable[[ss.WindowPoints], Any]:
    """A function that labels well until window `at`."""

    def segmentor(window: ss.WindowPoints) -> Any:
        return answer(len(window)) if window.index == at else np.zeros(len(window), int)

    segmentor.__name__ = "mine"
    return segmentor


def failure_of(segmentor: Any, kind: type[Exception], threads: int, result: Any = "carry") -> Exception:
    """Windows 0 and 1 are woven: spans 0 to 4 come out, in order, and then the failure, once."""
    indices: list[int] = []
    with ss.stream(heaps(10, 50), segmentor, spans=ss.SpanByCount(50), threads=threads, result=result) as run:
        with pytest.raises(kind) as caught:
            take(run, indices)
        assert indices == [0, 1, 2, 3, 4]
        assert list(run) == []
    return caught.value


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            lambda n: np.zeros(n - 1, int),
            r"'mine' returned labels of shape \(149,\), expected \(150,\): one label per point",
        ),
        (lambda n: np.zeros((n, 1), int), r"'mine' returned labels of shape \(150, 1\), expected \(150,\)"),
        (lambda _: np.zeros(0, int), r"'mine' returned labels of shape \(0,\), expected \(150,\)"),
        (lambda _: 3, r"'mine' returned labels of shape \(\), expected \(150,\)"),
        (lambda _: None, r"'mine' returned labels of shape \(\), expected \(150,\)"),
        (lambda n: np.zeros(n), r"'mine' returned labels of type float64, expected whole numbers; -1 = none"),
        (lambda n: ["a"] * n, r"'mine' returned labels of type <U1, expected whole numbers"),
        (lambda n: [None] * n, r"'mine' returned labels of type object, expected whole numbers"),
        (lambda n: np.full(n, -2), r"'mine' returned the label -2, allowed: 0 and above, or -1 = none"),
    ],
    ids=["short", "column", "empty", "number", "None", "float", "text", "objects", "below -1"],
)
def test_what_is_not_one_label_per_point_is_refused(answer: Callable[[int], Any], message: str, threads: int) -> None:
    failure = failure_of(answering(answer), ss.SegmentorError, threads)
    assert isinstance(failure, ValueError)
    assert re.search(message, str(failure))


class Broken(Exception):
    pass


@pytest.mark.parametrize("threads", [1, 2])
def test_an_exception_of_the_segmentor_passes_through_untouched(threads: int) -> None:
    raised = Broken("as it was")

    def break_down(count: int) -> None:
        raise raised

    failure = failure_of(answering(break_down), Broken, threads)
    assert failure is raised
    assert "break_down" in [frame.name for frame in traceback.extract_tb(failure.__traceback__)]


@pytest.mark.parametrize("result", ["history", "final"])
def test_spans_come_out_before_the_failure_whatever_the_result(result: str) -> None:
    failure_of(answering(lambda _: None), ss.SegmentorError, 1, result)


@pytest.mark.parametrize("thing", [DBSCAN, "proximity", 2.5, None, object()], ids=lambda value: type(value).__name__)
def test_what_is_no_segmentor_is_refused(thing: Any) -> None:
    allowed = r"allowed: a segmentor of streamseg, an object with fit_predict\(X\), or a function of the window"
    for call in (ss.stream, ss.segment, ss.segment_static):
        with pytest.raises(ss.InvalidParameter, match=allowed) as caught:
            call(heaps(), thing)
        assert repr(thing) in str(caught.value)


def test_a_function_gets_the_attributes_that_it_names() -> None:
    points = heaps(4)
    brightness = np.arange(len(points), dtype=np.float64)
    seen: dict[int, float] = {}

    def look(window: ss.WindowPoints) -> NDArray[np.int64]:
        given = window.attributes
        assert sorted(given) == ["Z", "intensity"]
        assert not given["intensity"].flags.writeable
        assert np.array_equal(given["Z"], window.points[:, 2])
        seen.update(zip(window.point_ids.tolist(), given["intensity"].tolist(), strict=True))
        return np.zeros(len(window), int)

    look.attributes = ["intensity", "Z"]  # type: ignore[attr-defined]
    ss.segment(points, look, spans=ss.SpanByCount(50), attributes={"Intensity": brightness})
    assert [seen[point] for point in range(len(points))] == brightness.tolist()


def test_a_function_has_no_neighborhood_to_compute_features_from() -> None:
    def look(window: ss.WindowPoints) -> NDArray[np.int64]:
        return by_heap(window.points)

    look.attributes = ["NormalZ"]  # type: ignore[attr-defined]
    with pytest.raises(ss.InvalidParameter, match="look has no neighborhood to compute it from"):
        ss.segment(heaps(), look)
    labels = ss.segment(heaps(), look, attributes={"NormalZ": np.zeros(len(heaps()))})
    assert same(labels, by_heap(heaps()))


# Segmentors of another package, as its pyproject.toml would announce them.
MODULE = """
import numpy as np
import streamseg as ss
from sklearn.cluster import DBSCAN


def heaps(window, *, apart=10.0):
    return np.round(window.points[:, 0] / apart).astype(np.int64)


heaps.attributes = ["Z"]
heaps.min_segment_size = 3


class Heaps:
    def __init__(self, apart=10.0):
        self.apart = apart

    def fit_predict(self, points):
        return np.round(points[:, 0] / self.apart).astype(np.int64)


def dense(eps=2.0):
    return ss.Dbscan(eps, min_points=3)


def strict(window, must):
    return np.zeros(len(window), int)


class Anything:
    def __init__(self, **parameters):
        raise TypeError("'far' is no number")


nothing = object()
"""
ANNOUNCED = """
[streamseg.segmentors]
heaps = MODULE:heaps
heap-class = MODULE:Heaps
dense = MODULE:dense
sklearn-dbscan = MODULE:DBSCAN
strict = MODULE:strict
anything = MODULE:Anything
nothing = MODULE:nothing
gone = MODULE:gone
no-module = MODULE_that_is_not_there:heaps
"""


def install(folder: Path, package: str, announced: str = ANNOUNCED) -> None:
    """Put a package where Python finds it, as an installer does."""
    module = package.replace("-", "_")
    (folder / f"{module}.py").write_text(MODULE)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(announced.replace("MODULE", module))


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    install(folder, "some-segmentors")
    monkeypatch.syspath_prepend(folder)
    return folder


@pytest.mark.usefixtures("installed")
def test_what_packages_announce_has_names() -> None:
    assert {"heaps", "heap-class", "dense", "sklearn-dbscan"} <= set(ss.plugin_names())
    assert ss.plugin_names() == sorted(ss.plugin_names())


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("heaps", {}),
        ("heaps", {"apart": 10.0}),
        ("heap-class", {"apart": 10.0}),
        ("dense", {}),
        ("dense", {"eps": 2.5}),
        ("sklearn-dbscan", {"eps": 2.0, "min_samples": 3}),
    ],
)
def test_a_plug_in_segments(name: str, parameters: dict[str, Any]) -> None:
    points = heaps()
    labels = ss.segment(points, ss.plugin(name, **parameters), spans=ss.SpanByWidth(20.0))
    assert agreement(labels, by_heap(points)) > 0.99


@pytest.mark.usefixtures("installed")
def test_a_function_of_the_window_stays_what_it_is() -> None:
    segmentor = ss.plugin("heaps", apart=20.0)
    assert (segmentor.__name__, segmentor.attributes, segmentor.min_segment_size) == ("heaps", ["Z"], 3)
    assert ss.segment_static(heaps(8), segmentor).max() < ss.segment_static(heaps(8), ss.plugin("heaps")).max()


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("heap", {}, "segmentor 'heap' is announced by no installed package; there are: .*heap-class"),
        ("heaps", {"far": 1}, "segmentor 'heaps' does not take these parameters: .*'far'"),
        ("heaps", {"window": 1}, "segmentor 'heaps' does not take these parameters: .*'window'"),
        ("strict", {}, "segmentor 'strict' does not take these parameters: .*'must'"),
        ("heap-class", {"far": 1}, "segmentor 'heap-class' does not take these parameters: .*'far'"),
        ("anything", {}, "segmentor 'anything' does not take these parameters: 'far' is no number"),
        ("nothing", {}, "segmentor 'nothing' does not take these parameters: .*not callable"),
        ("gone", {}, "segmentor 'gone' cannot be loaded from some_segmentors:gone: .*no attribute 'gone'"),
        ("no-module", {}, "segmentor 'no-module' cannot be loaded from .*No module named"),
    ],
)
def test_what_cannot_be_had_is_told(name: str, parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ss.InvalidParameter, match=message):
        ss.plugin(name, **parameters)


def test_two_packages_with_one_name_are_told(installed: Path) -> None:
    install(installed, "more-segmentors", "[streamseg.segmentors]\nheaps = MODULE:heaps\n")
    with pytest.raises(ss.InvalidParameter, match="'heaps' is announced by more-segmentors and some-segmentors"):
        ss.plugin("heaps")
    assert ss.plugin("dense") == ss.Dbscan(2.0, min_points=3)


def test_plug_ins_on_the_command_line(installed: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "heaps.npy", heaps())
    paths = os.pathsep.join([str(installed), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-m", "streamseg", "segment", "heaps.npy", "out.npy"]
    command += ["--method", "heaps", "--set", "apart=10", "--span-width", "20"]
    environment = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert same(np.load(tmp_path / "out.npy"), by_heap(heaps()))


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("method", "given", "settings", "message"),
    [
        ("heap", {}, [], "--method is 'heap', allowed: proximity, .*heap-class"),
        ("heaps", {}, ["apart"], "--set is 'apart', allowed: NAME=VALUE"),
        ("heaps", {}, ["far=1"], "segmentor 'heaps' does not take these parameters"),
        ("heaps", {"--eps": 1.0}, [], "--eps is given with --method heaps, allowed: --set NAME=VALUE"),
        ("proximity", {"--distance": 1.0}, ["apart=1"], "--set apart=1 is given with --method proximity"),
    ],
)
def test_wrong_options_of_plug_ins(method: str, given: dict[str, Any], settings: list[str], message: str) -> None:
    with pytest.raises(ss.InvalidParameter, match=message):
        chosen(method, given, settings)


@pytest.mark.usefixtures("installed")
def test_settings_are_numbers_or_text() -> None:
    made = chosen("sklearn-dbscan", {}, ["eps=2.5", "min_samples=7", "metric=manhattan", "p=None"])
    assert (made.eps, made.min_samples, made.metric, made.p) == (2.5, 7, "manhattan", None)
