"""Segmentors that a user brings: scikit-learn's objects and functions, with whatever they may return or raise."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN, HDBSCAN, AgglomerativeClustering, KMeans

import streamseg as ss
from reference.consumer import take
from reference.partition import agreement, same

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


@pytest.mark.parametrize("thing", [DBSCAN, "proximity", 2.5, None, object()], ids=repr)
def test_what_is_no_segmentor_is_refused(thing: Any) -> None:
    allowed = r"allowed: a segmentor of streamseg, an object with fit_predict\(X\), or a function of the window"
    for call in (ss.stream, ss.segment, ss.segment_static):
        with pytest.raises(ss.InvalidParameter, match=allowed) as caught:
            call(heaps(), thing)
        assert repr(thing) in str(caught.value)
