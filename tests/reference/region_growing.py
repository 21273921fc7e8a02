"""Region growing twice: PCL's loop step by step, and the order-free form from its definition, both from given normals.

Neighbors are in the order of (distance, number), the point itself first; distances are those of whole lattice steps.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

Reals = NDArray[np.float64]
Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]

NOBODY = -1
_MORE = 10
_BATCH = 50_000


def nearest(points: Reals, k: int, radius: float = np.inf) -> Numbers:
    """The k nearest of each point within a radius, (n, k); `NOBODY` where there are fewer."""
    tree = cKDTree(points)
    found = np.full((len(points), k), NOBODY)
    for begin in range(0, len(points), _BATCH):
        queries = np.arange(begin, min(begin + _BATCH, len(points)))
        near = tree.query(points[queries], range(1, k + _MORE + 1), workers=-1)[1]
        ordered, squared = _ordered(points, queries, near)
        is_near = np.isfinite(squared[:, :k]) & (squared[:, :k] <= radius * radius)
        found[queries] = np.where(is_near, ordered[:, :k], NOBODY)
        # Where the last that was found may be as near as the k-th, others may be too.
        for row in np.flatnonzero(squared[:, -1] <= squared[:, k - 1] * (1 + 1e-9)):
            if np.isinf(squared[row, k - 1]):
                continue
            around = np.array(tree.query_ball_point(points[queries[row]], np.sqrt(squared[row, k - 1]) * (1 + 1e-9)))
            ordered_row, squared_row = _ordered(points, queries[row : row + 1], around[None])
            chosen = ordered_row[0, :k]
            found[queries[row], : len(chosen)] = np.where(squared_row[0, :k] <= radius * radius, chosen, NOBODY)
    return found


def _ordered(points: Reals, queries: Numbers, near: Numbers) -> tuple[Numbers, Reals]:
    """Neighbors in canonical order, and their squared distances; infinite where there is none."""
    is_there = near < len(points)
    x, y, z = (points[np.where(is_there, near, 0), axis] - points[queries, axis, None] for axis in range(3))
    squared = np.where(is_there, x * x + y * y + z * z, np.inf)
    order = np.lexsort((near, near != queries[:, None], squared), axis=1)
    return np.take_along_axis(near, order, 1), np.take_along_axis(squared, order, 1)


@dataclass(frozen=True)
class Surface:
    """Points, neighbors, and what is known of the surface at each point."""

    points: Reals
    """(n, 3), in steps."""
    scale: float
    neighbors: Numbers
    """(n, k)."""
    normals: Reals
    """(n, 3)."""
    curvature: Reals
    """(n,)."""
    angle_deg: float = 30.0
    max_curvature: float = 0.05
    residual: float = np.inf

    def alike(self, p: Numbers, q: Numbers) -> Flags:
        """Whether two normals differ by no more than the angle, whichever way they point."""
        return np.abs(self._dot(self.normals[p], self.normals[q])) >= np.cos(np.deg2rad(self.angle_deg))

    def near(self, p: Numbers, q: Numbers) -> Flags:
        """Whether q lies on the tangent plane at p."""
        apart = (self.points[p] - self.points[q]) * self.scale
        return np.abs(self._dot(self.normals[p], apart)) <= self.residual

    def smooth(self) -> Flags:
        """Which points regions grow on from."""
        return ~np.isnan(self.normals[:, 0]) & (self.curvature <= self.max_curvature)

    @staticmethod
    def _dot(a: Reals, b: Reals) -> Reals:
        product: Reals = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
        return product


def order_free(surface: Surface) -> Numbers:
    """Components of the symmetrised neighbor graph over smooth points; rough ones go to the nearest that is alike."""
    neighbors, smooth = surface.neighbors, surface.smooth()
    n, k = neighbors.shape
    p = np.broadcast_to(np.arange(n)[:, None], (n, k))
    # Nobody is like nobody.
    alike = (neighbors != NOBODY) & smooth[neighbors] & surface.alike(p, neighbors)
    joined = alike & smooth[p]
    a, b = p[joined], neighbors[joined]
    kept = surface.near(a, b) & surface.near(b, a)
    graph = coo_array((np.ones(kept.sum(), bool), (a[kept], b[kept])), shape=(n, n))
    component = connected_components(graph, directed=False)[1].astype(np.int64)
    first = np.argmax(alike, axis=1)
    rough = np.where(alike.any(axis=1), component[neighbors[np.arange(n), first]], -1)
    return np.where(smooth, component, rough)


def literal(surface: Surface, *, smooth_mode: bool = True) -> Numbers:
    """PCL's `RegionGrowing::extract`: seeds by curvature, a queue per region, first come, first served."""
    n = len(surface.points)
    flat = surface.curvature <= surface.max_curvature
    labels = np.full(n, -1)
    segment = 0
    for first in np.lexsort((np.arange(n), surface.curvature)):
        if labels[first] != -1:
            continue
        labels[first] = segment
        queue = deque([first])
        while queue:
            point = queue.popleft()
            near = surface.neighbors[point]
            near = near[near != NOBODY]
            near = near[labels[near] == -1]
            if len(near) == 0:
                continue
            near = near[surface.alike(point if smooth_mode else first, near)]
            labels[near] = segment
            queue.extend(near[flat[near] & surface.near(point, near)].tolist())
        segment += 1
    return labels
