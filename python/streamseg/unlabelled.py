"""Why points have no segment: each that comes out as -1 has exactly one cause, and all of them are counted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

# What people are told of a number of points, if nothing more is known.
_WORDS = {
    "invalid": "with coordinates that are not finite",
    "removed": "removed beforehand",
    "filtered": "left out by the filter",
    "no_seed": "without a seed",
    "noise": "noise",
    "in_no_plane": "in no plane",
    "in_no_region": "in no region",
    "by_segmentor": "given none by the segmentor",
    "undecided": "undecided",
    "too_small": "in segments that are too small",
    "too_large": "in segments that are too large",
}


class Unlabelled(NamedTuple):
    """How many points have no segment, by cause. Each has one cause, so the counts add up to the points with -1.

    Where windows disagree about a point, a segment counts, else the cause with which it came furthest. Sizes and the
    seeds of whole segments are causes of final ids only.
    """

    invalid: int = 0
    """Points without finite coordinates (``drop_invalid``)."""
    removed: int = 0
    """Points that a stage of preprocessing removed."""
    filtered: int = 0
    """Points that the filter leaves out."""
    no_seed: int = 0
    """Points that no segment from a seed reached, or whose segment holds no seed."""
    noise: int = 0
    """Points that are neither core nor border of `Dbscan`."""
    in_no_plane: int = 0
    """Points in none of the planes of `PlaneExtraction`."""
    in_no_region: int = 0
    """Points in no region of `RegionGrowing`: rough and like none of their smooth neighbors, or without a normal."""
    by_segmentor: int = 0
    """Points to which a segmentor in Python gave -1."""
    undecided: int = 0
    """Points that went out of scope before any window held all that decides about them."""
    too_small: int = 0
    """Points of segments with fewer points than ``min_segment_size``."""
    too_large: int = 0
    """Points of segments with more points than ``max_segment_size``."""

    @property
    def total(self) -> int:
        """How many points have no segment."""
        return sum(self)

    @property
    def causes(self) -> dict[str, int]:
        """The causes that there are, the one of the most points first: name → points."""
        found = {cause: points for cause, points in self._asdict().items() if points}
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def with_more(self, more: Mapping[str, int]) -> Unlabelled:
        """Add points: name of the cause → points."""
        return Unlabelled(**{cause: points + more.get(cause, 0) for cause, points in self._asdict().items()})

    def told(self, words: Mapping[str, str]) -> str:
        """Tell the counts in other words for some causes."""
        words = {**_WORDS, **words}
        return ", ".join(f"{points:,} {words[cause]}" for cause, points in self.causes.items())

    def __str__(self) -> str:
        return self.told({}) or "none"
