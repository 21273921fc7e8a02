"""A labelled file seen from above: the highest point of each pixel, drawn in chunks."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from .sink import read_labels

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]

_SAMPLED_POINTS = 400_000
_ROBUST_PERCENT = 0.1
_OUTLIER_STRETCH = 1.3
_LARGEST_DOT = 8
_NEAR_PIXELS = (1, 2, 4, 8)
_BLOCK = 16


class Survey(NamedTuple):
    """What a first pass finds out.

    low, high : (2,) float64, the frame in x and y; far outliers lie outside
    points : number of points
    ids, counts : (k,) int64, the segments, −1 included, and their numbers of points
    """

    low: Floats
    high: Floats
    points: int
    ids: Ids
    counts: Ids


class Raster(NamedTuple):
    """The highest point of each pixel, seen from above; row 0 is the north edge.

    height : (rows, columns) float64, −inf where there is no point
    ids : (rows, columns) int64, segment of that point
    pixel : side of a pixel in the units of the coordinates
    outside : points beyond the edges
    """

    height: Floats
    ids: Ids
    pixel: float
    outside: int


def survey(labelled: Path, id_name: str | None = None) -> Survey:
    """First pass: how many points, which segments, and the frame that leaves far outliers out."""
    points, low, high = 0, np.full(2, np.inf), np.full(2, -np.inf)
    sample: list[Floats] = []
    stride = 1
    ids, counts = np.empty(0, np.int64), np.empty(0, np.int64)
    for chunk, segments in _finite(read_labels(labelled, id_name=id_name)):
        points += len(chunk)
        low, high = np.minimum(low, chunk[:, :2].min(axis=0)), np.maximum(high, chunk[:, :2].max(axis=0))
        sample.append(chunk[::stride, :2].copy())
        while sum(map(len, sample)) > _SAMPLED_POINTS:
            sample, stride = [part[::2].copy() for part in sample], 2 * stride
        new_ids, new_counts = np.unique(segments, return_counts=True)
        ids, inverse = np.unique(np.concatenate((ids, new_ids)), return_inverse=True)
        counts = np.bincount(inverse, np.concatenate((counts, new_counts)), len(ids)).astype(np.int64)
    robust = np.percentile(np.concatenate(sample), (_ROBUST_PERCENT, 100 - _ROBUST_PERCENT), axis=0)
    margin = (robust[1] - robust[0]) * 0.02
    far = (high - low) > _OUTLIER_STRETCH * (robust[1] - robust[0] + 2 * margin)
    low = np.where(far, np.maximum(low, robust[0] - margin), low)
    high = np.where(far, np.minimum(high, robust[1] + margin), high)
    return Survey(low, high, points, ids, counts)


def rasterize(
    labelled: Path, low: Floats, high: Floats, size: int, panels: int = 1, id_name: str | None = None
) -> Raster:
    """Draw the points between `low` and `high` (x, y) onto a raster that fits `size` pixels."""
    extent = np.maximum(high - low, 1e-9)
    pixel = float(max(extent[0] * panels, extent[1]) / size)
    if not (high > low).any():
        pixel = 1.0 / size
    columns, rows = (int(length / pixel) + 1 for length in extent)
    height = np.full(rows * columns, -np.inf)
    ids = np.full(rows * columns, -1, np.int64)
    outside = 0
    for points, segments in read_labels(labelled, id_name=id_name):
        inside = ((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)
        outside += len(points) - int(inside.sum())
        x, y, z = points[inside].T
        at = (rows - 1 - ((y - low[1]) / pixel).astype(np.int64)) * columns + ((x - low[0]) / pixel).astype(np.int64)
        order = np.lexsort((z, at))
        highest = order[np.append(at[order][1:] != at[order][:-1], True)] if len(order) else order
        highest = highest[z[highest] > height[at[highest]]]
        height[at[highest]] = z[highest]
        ids[at[highest]] = segments[inside][highest]
    return Raster(height.reshape(rows, columns), ids.reshape(rows, columns), pixel, outside)


def fill_gaps(raster: Raster) -> Raster:
    """Let points grow into empty pixels until a sparse cloud looks like a surface; higher points win."""
    height, ids = raster.height.copy(), raster.ids.copy()
    for step in range(_dot_radius(height > -np.inf)):
        grown, grown_ids = height.copy(), ids.copy()
        # Diamonds and squares in turn make dots that are nearly round.
        for dy, dx in DIRECTIONS[: 4 if step % 2 else 8]:
            target, source = shifted(height.shape, dy, dx)
            better = (height[target] == -np.inf) & (height[source] > grown[target])
            grown[target][better] = height[source][better]
            grown_ids[target][better] = ids[source][better]
        height, ids = grown, grown_ids
    return raster._replace(height=height, ids=ids)


def touching(index: NDArray[np.intp], shown: Ids) -> list[NDArray[np.intp]]:
    """For each segment those that come within a few pixels of it."""
    pairs = np.empty(0, np.int64)
    for distance in _NEAR_PIXELS:
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            if distance >= min(index.shape) and distance > 1:
                continue
            one, other = shifted(index.shape, dy * distance, dx * distance)
            a, b = index[one], index[other]
            meet = (a != b) & (shown[a] >= 0) & (shown[b] >= 0)
            a, b = a[meet], b[meet]
            pairs = np.union1d(pairs, np.minimum(a, b) * len(shown) + np.maximum(a, b))
    first, second = np.divmod(pairs, len(shown))
    pairs = np.sort(np.concatenate((pairs, second * len(shown) + first)))
    first, second = np.divmod(pairs, len(shown))
    return np.split(second, np.searchsorted(first, np.arange(1, len(shown))))


def hillshade(raster: Raster) -> NDArray[np.float32]:
    """Brightness of the relief, lit from the north-west: 1 on flat ground, (rows, columns) float32."""
    drawn = raster.height > -np.inf
    low, high = height_range(raster.height)
    above = np.where(drawn, raster.height.clip(low, high) - low, 0.0).astype(np.float32)
    height = _smoothed(above, drawn)
    # Flat scenes are exaggerated and steep ones calmed, so that both show relief.
    exaggeration = min(0.06 * max(height.shape) * raster.pixel / (high - low), 4.0)
    padded = np.pad(height, 1, mode="edge")
    south = np.nan_to_num((padded[2:, 1:-1] - padded[:-2, 1:-1]) / (2 * raster.pixel)) * exaggeration
    east = np.nan_to_num((padded[1:-1, 2:] - padded[1:-1, :-2]) / (2 * raster.pixel)) * exaggeration
    # The dot product of the surface's upward normal and the light, relative to flat ground.
    facing = (1 + 0.7 * (south + east)) / np.sqrt(1 + south**2 + east**2)
    lit: NDArray[np.float32] = 0.45 + 0.55 * facing.clip(0, 1.6) + 0.15 * (above / (high - low) - 0.4)
    return lit.clip(0.42, 1.35)


def height_range(height: Floats) -> tuple[float, float]:
    """Lowest and highest height to tell apart: the percentiles 1 and 99 of what is drawn."""
    low, high = np.percentile(height[height > -np.inf], (1, 99))
    return (float(low), float(high)) if high > low else (float(low) - 0.5, float(high) + 0.5)


def _smoothed(height: NDArray[np.float32], drawn: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Mean of each drawn pixel and its drawn neighbors; NaN elsewhere."""
    total, weight = 2 * height, np.float32(2) * drawn
    for dy, dx in DIRECTIONS:
        target, source = shifted(height.shape, dy, dx)
        total[target] += height[source]
        weight[target] += drawn[source]
    mean: NDArray[np.float32] = np.where(drawn, total / np.maximum(weight, 1), np.float32(np.nan))
    return mean


DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))


def shifted(shape: tuple[int, ...], dy: int, dx: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of the pixels that have a neighbor at (dy, dx), and of these neighbors."""

    def pair(length: int, step: int) -> tuple[slice, slice]:
        return slice(max(0, -step), length - max(0, step)), slice(max(0, step), length - max(0, -step))

    rows, columns = pair(shape[0], dy), pair(shape[1], dx)
    return (rows[0], columns[0]), (rows[1], columns[1])


def _dot_radius(drawn: NDArray[np.bool_]) -> int:
    """About half the distance between points, in pixels."""
    rows, columns = (-(-length // _BLOCK) * _BLOCK for length in drawn.shape)
    padded = np.zeros((rows, columns), np.bool_)
    padded[: drawn.shape[0], : drawn.shape[1]] = drawn
    count = int(drawn.sum())
    covered = padded.reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK).any(axis=(1, 3)).sum() * _BLOCK * _BLOCK
    return min(_LARGEST_DOT, int(np.ceil(np.sqrt(covered / count) * 0.6 - 0.3)))


def _finite(chunks: Iterator[tuple[Floats, Ids]]) -> Iterator[tuple[Floats, Ids]]:
    for points, ids in chunks:
        if not np.isfinite(points).all():
            raise InvalidInput("the labelled file has coordinates that are not finite numbers, which cannot be drawn")
        yield points, ids
