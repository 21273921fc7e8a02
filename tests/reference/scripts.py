"""Made-up segmentations: spans of points and a table of labels, for tests that look at the weaver alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss

from .weaver import Weaver


@dataclass(frozen=True)
class Script:
    """What comes in, and what the segmentor says of it."""

    span_points: list[int]
    window: ss.Window
    labels: list[int]
    """Read round and round: the label of a point in a window depends on nothing but the two."""

    def spans(self) -> list[NDArray[np.float64]]:
        points = np.arange(3.0 * sum(self.span_points)).reshape(-1, 3)
        return np.split(points, np.cumsum(self.span_points)[:-1])

    def label(self, window: int, point: int) -> int:
        return self.labels[(5 * window + point) % len(self.labels)]

    def segmentor(self) -> Callable[[ss.WindowPoints], NDArray[np.int64]]:
        def labels(window: ss.WindowPoints) -> NDArray[np.int64]:
            return np.array([self.label(window.index, point) for point in window.point_ids.tolist()], np.int64)

        return labels

    def windows(self) -> list[list[int]]:
        """The points of each window; the last has what is left."""
        ends = np.cumsum([0, *self.span_points]).tolist()
        count, size = len(self.span_points), self.window
        windows, first = [], 0
        while not windows or first + size.overlap < count:
            windows.append(list(range(ends[first], ends[min(first + size.spans, count)])))
            first += size.advance
        return windows

    def weave(self) -> tuple[Weaver, list[tuple[int, int]]]:
        """The twin after the last segmentation, and the entries of its tables after each."""
        weaver, entries = Weaver(), []
        for index, points in enumerate(self.windows()):
            weaver.segmentation(points, [self.label(index, point) for point in points])
            entries.append((len(weaver.point_segment), len(weaver.segment_segment)))
        weaver.last_segmentation()
        return weaver, entries


windows = st.tuples(st.integers(1, 5), st.integers(1, 4)).filter(lambda w: w[1] < w[0]).map(lambda w: ss.Window(*w))
scripts = st.builds(
    Script,
    st.lists(st.integers(0, 5), min_size=1, max_size=9),
    windows,
    st.lists(st.integers(-1, 4), min_size=1, max_size=40),
)
