"""The weaver as the paper tells it (section 2.1.2): two look-up tables that are dicts, and two files that are lists.

A point without a label (−1) is in no segment: it is not looked up, and a later window may still give it one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

NONE = -1


class SegmentRow(NamedTuple):
    """A line of the segment-segment file."""

    segment_id: int
    next_segment_id: int
    window: int
    shared_points: int


class Weaver:
    """Stitches the segmentations of successive windows together."""

    def __init__(self) -> None:
        # The look-up tables: point → segment, and segment → {segment to its right: points they share}.
        self.point_segment: dict[int, int] = {}
        self.segment_segment: dict[int, dict[int, int]] = {}
        # The files.
        self.point_segment_file: dict[int, int] = {}
        self.segment_segment_file: list[SegmentRow] = []
        self.last_label = 0
        self.windows = 0
        self._previous: set[int] = set()
        self._points_of: dict[int, set[int]] = {}
        self._window_of: dict[int, int] = {}

    def segmentation(self, points: Sequence[int], labels: Sequence[int]) -> None:
        """The first, the second and each succeeding segmentation."""
        # "All points not inside the current or previous window are said to be out of scope."
        self._unload(self._previous.union(points))
        # "All new segments are labeled sequentially starting from the last segment label."
        segment_of: dict[int, int] = {}
        for label in labels:
            if label != NONE and label not in segment_of:
                self.last_label += 1
                segment_of[label] = self.last_label
        for segment in segment_of.values():
            # "… there are no overlapping segments to the right": no successor yet, −1.
            self.segment_segment[segment] = {}
            self._points_of[segment] = set()
            self._window_of[segment] = self.windows
        for point, label in zip(points, labels, strict=True):
            if label == NONE:
                continue
            segment = segment_of[label]
            self._points_of[segment].add(point)
            if point in self.point_segment:
                # "If the point exists in the LUT nothing further is done for the Point-Segment LUT. However in the
                # Segment-Segment LUT the key-value pairs are updated for those segments that overlap."
                right = self.segment_segment[self.point_segment[point]]
                right[segment] = right.get(segment, 0) + 1
            else:
                self.point_segment[point] = segment
        self._previous = set(points)
        self.windows += 1

    def last_segmentation(self) -> None:
        """All remaining points and segment labels are written, then unloaded."""
        self._unload(set())

    def _unload(self, scope: set[int]) -> None:
        for point in [point for point in self.point_segment if point not in scope]:
            self.point_segment_file[point] = self.point_segment.pop(point)
        # "Segments go out of scope when none of their points lie inside the current or previous window."
        for segment in [segment for segment in self.segment_segment if not self._points_of[segment] & scope]:
            right = self.segment_segment.pop(segment)
            for successor, shared in sorted(right.items()):
                row = SegmentRow(segment, successor, self._window_of[successor], shared)
                self.segment_segment_file.append(row)
            if not right:
                self.segment_segment_file.append(SegmentRow(segment, NONE, NONE, 0))


def sizes(point_segment: Mapping[int, int], final: Mapping[int, int]) -> Counter[int]:
    """How many points each whole has; a point is in the file once."""
    return Counter(final[segment] for segment in point_segment.values())


def final_ids(pairs: Iterable[tuple[int, int]]) -> dict[int, int]:
    """The smallest raw id of each component of the segment-segment graph, by union-find; a successor of −1 is none."""
    parent: dict[int, int] = {}

    def find(segment: int) -> int:
        while parent.setdefault(segment, segment) != segment:
            segment = parent[segment]
        return segment

    for segment, successor in pairs:
        a = find(segment)
        if successor != NONE:
            b = find(successor)
            parent[max(a, b)] = min(a, b)
    return {segment: find(segment) for segment in list(parent)}
