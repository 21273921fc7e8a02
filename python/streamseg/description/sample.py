"""Points that stand for a cloud: all of a small one, else those around a few places, all of them there.

Neighbors are known only where nothing is missing, so a sample is made of blocks: the points nearest to a seed. Seeds
are the points whose coordinates have the smallest hashes. So a dense place gets more of them, and the same points in
another order give the same sample.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ..io import Cloud

SEEDS = 8
POINTS_PER_BLOCK = 20_000
# A cloud of up to so many points is its own sample.
WHOLE = SEEDS * POINTS_PER_BLOCK

# Points that distances are measured among, around each seed.
POINTS_AROUND = 5_000

# Squares of lengths are to be numbers, too.
SHORTEST, LONGEST = 1e-100, 1e100

# Fewer different places tell nothing about a cloud.
FEWEST = 30


class Blocks(NamedTuple):
    """A sample of a cloud.

    points : (n, 3) float64, block after block; blocks lie far apart, and equal points are there once
    block : (n,) which block a point belongs to
    around : for some places, the indices of the points nearest to them, nearest first; nothing is missing in between
    is_whole : whether this is all of the cloud
    """

    points: NDArray[np.float64]
    block: NDArray[np.int64]
    around: tuple[NDArray[np.int64], ...]
    is_whole: bool


class Sampler:
    """Takes the points of the first reading, and reads again if it has to."""

    def __init__(self) -> None:
        self._kept: list[NDArray[np.float64]] | None = []
        self._count = 0
        self._seeds = np.empty((0, 3))

    def see(self, points: NDArray[np.float64]) -> None:
        """Take finite (n, 3) coordinates."""
        if not len(points):
            return
        self._seeds = _of_smallest_hash(np.concatenate([self._seeds, points]), SEEDS)
        self._count += len(points)
        if self._count > WHOLE:
            self._kept = None
        elif self._kept is not None:
            self._kept.append(points.copy())

    def blocks(self, cloud: Cloud) -> Blocks | None:
        """Make the sample; None if the points lie at too few places."""
        if self._kept is not None:
            whole = np.concatenate([np.empty((0, 3)), *self._kept])
            return _laid_apart([different(whole)], self._seeds, is_whole=True)
        around = [_Neighborhood(seed) for seed in self._seeds]
        for chunk in cloud.chunks():
            real = finite(cloud.lattice.to_coordinates(chunk.points))
            for neighborhood in around:
                neighborhood.see(real)
        return _laid_apart([neighborhood.points for neighborhood in around], self._seeds, is_whole=False)


def finite(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take the points all of whose coordinates are finite."""
    return points[np.isfinite(points).all(axis=1)]


def different(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take each point once, in the order of their coordinates."""
    points = points[np.lexsort(points.T[::-1])]
    is_new = np.ones(len(points), bool)
    is_new[1:] = (points[1:] != points[:-1]).any(axis=1)
    return points[is_new]


class _Neighborhood:
    """The points nearest to a seed, nearest first; at equal distance those with smaller coordinates."""

    def __init__(self, seed: NDArray[np.float64]) -> None:
        self._seed = seed
        self._farthest = np.inf
        self.points = np.empty((0, 3))

    def see(self, points: NDArray[np.float64]) -> None:
        points = points[self._distances(points) <= self._farthest]
        if not len(points):
            return
        points = self._different(np.concatenate([self.points, points]))
        distances = self._distances(points)
        nearest = np.argsort(distances, kind="stable")[:POINTS_PER_BLOCK]
        self.points = points[nearest]
        if len(nearest) == POINTS_PER_BLOCK:
            self._farthest = float(distances[nearest[-1]])

    def _different(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take each point once; of many only those that can be among the nearest."""
        distances = self._distances(points)
        enough = 2 * POINTS_PER_BLOCK
        if len(points) > enough:
            found = different(points[distances <= np.partition(distances, enough)[enough]])
            if len(found) >= POINTS_PER_BLOCK:
                return found
        return different(points)

    def _distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(over="ignore"):
            apart = points - self._seed
            return np.asarray(np.einsum("ij,ij->i", apart, apart))


def _of_smallest_hash(points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Take the points of different places whose coordinates have the smallest hashes."""
    hashes, first = np.unique(_hash(points), return_index=True)
    del hashes
    return points[first[:count]]


def _hash(points: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Mix the bits of the coordinates (splitmix64)."""
    mixed = np.zeros(len(points), np.uint64)
    for axis in range(3):
        mixed ^= (points[:, axis] + 0.0).view(np.uint64)  # + 0.0: there is no -0.0
        mixed += np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(31)
    return mixed


def _laid_apart(blocks: Sequence[NDArray[np.float64]], seeds: NDArray[np.float64], *, is_whole: bool) -> Blocks | None:
    """Move each block to a place of its own along x, with more than its own length between any two."""
    if sum(map(len, blocks)) < FEWEST:
        return None
    with np.errstate(over="ignore"):
        middles = [block.min(axis=0) / 2 + block.max(axis=0) / 2 for block in blocks]
        centered = [block - middle for block, middle in zip(blocks, middles, strict=True)]
        apart = 8 * max(float(np.abs(block).max()) for block in centered)
    if not SHORTEST < apart < LONGEST:
        return None
    moved = [block + np.array([number * apart, 0, 0]) for number, block in enumerate(centered)]
    if is_whole:
        around = [_nearest(blocks[0], seed) for seed in seeds]
    else:
        starts = np.cumsum([0, *map(len, blocks)])
        around = [start + _nearest(block, seed) for start, block, seed in zip(starts[:-1], blocks, seeds, strict=True)]
    return Blocks(
        np.ascontiguousarray(np.concatenate(moved)),
        np.repeat(np.arange(len(blocks)), [len(block) for block in blocks]),
        tuple(around),
        is_whole,
    )


def _nearest(points: NDArray[np.float64], seed: NDArray[np.float64]) -> NDArray[np.int64]:
    apart = points - seed
    return np.argsort(np.einsum("ij,ij->i", apart, apart), kind="stable")[:POINTS_AROUND]
