"""Segmentations that are tried on a sample, and what comes of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._core import PlaneExtraction, Proximity, RegionGrowing
from ..run import segment_static
from .shape import K

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .sample import Blocks
    from .shape import Shape

# Segments with fewer points are small: most often stray points.
SMALL = 10

# As much as this of the points may be in small segments or lines, and in the largest segment;
# with more a trial is no good.
_MOST_SCATTERED, _MOST_IN_LARGEST = 0.15, 0.9

# A segment is a line if its variance across is at most this share of that along it.
_THIN = 0.02

# Distances that are tried first, in spacings; how often it is gone on from there, and how often the range is halved.
# Scan lines can be a hundred times as far apart as their points.
_NEAREST, _FARTHEST, _EXTENSIONS, _HALVINGS = 0.7, 12.0, 2, 6

# A distance is stable if one so much greater still leaves more than one segment.
_STABLE = 1.2


class Trial(NamedTuple):
    """A segmentor, and what it makes of a sample.

    labelled : share of the points with a segment that is not small
    largest : share of the points in the largest segment of their block
    in_lines : share of the points in segments that are no more than a line
    """

    segmentor: Any
    labelled: float
    largest: float
    in_lines: float

    @property
    def scattered(self) -> float:
        """How far what it breaks up is from being too much; a scan line is no object either."""
        return (1 - self.labelled + self.in_lines) / _MOST_SCATTERED

    @property
    def crowded(self) -> float:
        """How far the largest segment is from being too much."""
        return self.largest / _MOST_IN_LARGEST

    @property
    def cost(self) -> float:
        """How far it is from what is wanted: below 1 it is useful."""
        return max(self.scattered, self.crowded)


def tried(blocks: Blocks, shape: Shape, segmentor: Any) -> Trial:
    """Segment a sample."""
    labels = segment_static(blocks.points, segmentor)
    counts = np.bincount(labels[labels >= 0], minlength=1)
    is_kept = (labels >= 0) & (counts[labels] >= SMALL)
    kept, total = labels[is_kept], len(labels)
    in_block = np.bincount(blocks.block[is_kept] * len(counts) + kept, minlength=(blocks.block[-1] + 1) * len(counts))
    return Trial(
        segmentor,
        len(kept) / total,
        float(in_block.reshape(-1, len(counts)).max(axis=1).sum() / total),
        float(counts[_lines(blocks.points[is_kept], kept, len(counts), shape.spacing)].sum() / total),
    )


def _lines(points: NDArray[np.float64], labels: NDArray[np.int64], count: int, spacing: float) -> NDArray[np.bool_]:
    """Tell which segments are narrower than the spacing, and next to nothing but long."""
    members = np.bincount(labels, minlength=count)
    means = np.stack([np.bincount(labels, points[:, axis], count) for axis in range(3)], axis=1)
    apart = points - (means / np.maximum(members, 1)[:, None])[labels]
    covariance = np.empty((count, 3, 3))
    for row in range(3):
        for column in range(3):
            covariance[:, row, column] = np.bincount(labels, apart[:, row] * apart[:, column], count)
    _, middle, greatest = np.linalg.eigvalsh(covariance).T
    is_thin = (middle <= _THIN * greatest) & (middle <= members * spacing**2)
    return np.asarray(is_thin & (members > 0))


def best_distance(blocks: Blocks, shape: Shape, graph: str) -> tuple[Trial, bool]:
    """Find the distance at which neither small segments nor the largest one take too much of the points.

    With the distance the small segments become fewer and the largest grows, so there is one place where both are
    equally far from being too much. Returned with whether it is stable: whether a slightly greater distance leaves
    more than one piece, too.
    """
    near, far = _NEAREST * shape.spacing, _FARTHEST * shape.spacing
    for _ in range(_EXTENSIONS):
        trial = tried(blocks, shape, Proximity(far, graph=graph))
        if trial.scattered <= trial.crowded:
            break
        near, far = far, far * _FARTHEST
    for _ in range(_HALVINGS):
        middle = math.sqrt(near * far)
        trial = tried(blocks, shape, Proximity(middle, graph=graph))
        if trial.scattered > trial.crowded:
            near = middle
        else:
            far = middle
    best = tried(blocks, shape, Proximity(rounded(far), graph=graph))
    beyond = tried(blocks, shape, Proximity(_STABLE * best.segmentor.distance, graph=graph))
    return best, beyond.largest < _MOST_IN_LARGEST


def planes(blocks: Blocks, shape: Shape) -> Trial | None:
    """Try planes as rough as the surfaces of the sample are; None if there are no surfaces."""
    if shape.noise is None:
        return None
    noise = max(shape.noise, shape.spacing / 100)
    seeds = rounded(1.5 * noise)
    return tried(
        blocks,
        shape,
        PlaneExtraction(
            rounded(4 * shape.spacing),
            k=K,
            max_distance=rounded(3 * noise),
            max_sigma=seeds,
            min_angle_deg=25.0,
            seed_calculator=f"NormalSigma0 < {seeds:g} ? NormalSigma0 : invalid",
            min_segment_size=20,
        ),
    )


def growing(blocks: Blocks, shape: Shape) -> Trial:
    """Try pieces of surface that may bend."""
    return tried(blocks, shape, RegionGrowing(K, search_radius=rounded(6 * shape.spacing), angle_deg=15.0))


def rounded(number: float) -> float:
    """Round to two digits that count."""
    return float(f"{number:.2g}")
