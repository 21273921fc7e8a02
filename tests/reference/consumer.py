"""Those who take spans from a stream."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

import streamseg as ss

Ids = NDArray[np.int64]


def take(spans: Iterable[ss.Span], indices: list[int]) -> None:
    """Take spans and note their indices, also of those that come before a failure."""
    for span in spans:
        indices.append(span.index)  # noqa: PERF401 (a list in the making is lost in a failure)


def in_order(point_ids: list[Ids], values: list[Ids]) -> Ids:
    """Values of points, which come once each, in the order of their ids."""
    points, ids = np.concatenate(point_ids), np.concatenate(values)
    assert np.array_equal(np.sort(points), np.arange(len(points))), "each point comes out once"
    ordered = np.empty_like(ids)
    ordered[points] = ids
    return ordered


def ids_of(spans: Iterable[ss.Span]) -> Ids:
    """Segment ids of all points, which come once each, in the order of the point ids."""
    taken = [(span.point_ids, span.segment_ids) for span in spans]
    return in_order([point_ids for point_ids, _ in taken], [segment_ids for _, segment_ids in taken])


class Follower:
    """Takes carried ids as they come, and knows of late joins only what the spans' aliases say."""

    def __init__(self, spans: Iterable[ss.Span]) -> None:
        self.point_ids: list[Ids] = []
        self.carried: list[Ids] = []
        self.aliases = 0
        # The present name of each id that has come, and the ids that go by a name.
        self._name: dict[int, int] = {}
        self._named: dict[int, list[int]] = {}
        for span in spans:
            for old, new in span.aliases.tolist():
                self._rename(old, new)
            for segment in np.unique(span.segment_ids[span.segment_ids != -1]).tolist():
                self._meet(segment)
            self.point_ids.append(span.point_ids)
            self.carried.append(span.segment_ids)

    def _rename(self, old: int, new: int) -> None:
        assert new < old
        assert self._name.get(old) == old, f"alias of {old}, which is not the present name of anything handed out"
        for segment in self._named.pop(old):
            self._name[segment] = new
            self._named.setdefault(new, []).append(segment)
        self.aliases += 1

    def _meet(self, segment: int) -> None:
        if segment not in self._name:
            self._name[segment] = segment
            self._named.setdefault(segment, []).append(segment)
        assert self._name[segment] == segment, f"{segment} came out after it had become {self._name[segment]}"

    def final(self) -> Ids:
        """The id of each point after all aliases, in the order of the point ids."""
        known = np.full(max(self._name, default=0) + 2, -1, np.int64)
        for segment, name in self._name.items():
            known[segment] = name
        return in_order(self.point_ids, [known[ids] for ids in self.carried])
