"""Proximity segmentation (paper, section 3.2) on lattice coordinates, decided in whole numbers.

"A Delaunay triangulation was used to generate the edges between the points." Those no longer than the distance are
kept, and their connected components are the segments. Points with equal xy are one place of the triangulation; two
points are neighbors when they are at the same place or at adjacent ones.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from math import floor

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

Steps = NDArray[np.int64]
Pairs = NDArray[np.int64]
Labels = NDArray[np.int64]


def squared_limit(distance: float, scale: float = 1.0) -> int:
    """Greatest squared length in steps that is still within the distance; both are meant as decimals."""
    return floor((Fraction(str(distance)) / Fraction(str(scale))) ** 2)


def components(count: int, pairs: Pairs) -> Labels:
    """Label the connected components of `count` nodes."""
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def within(points: Steps, pairs: Pairs, limit: int, metric: str) -> Pairs:
    """Keep the pairs whose squared length is within the limit."""
    axes = 3 if metric == "xyz" else 2
    difference = points[pairs[:, 0], :axes] - points[pairs[:, 1], :axes]
    return pairs[(difference**2).sum(axis=1) <= limit]


def radius(points: Steps, distance: float, scale: float = 1.0) -> Labels:
    """Components of the 2-D radius graph."""
    limit = squared_limit(distance, scale)
    places, place_of = np.unique(points[:, :2], axis=0, return_inverse=True)
    near = cKDTree(places).query_pairs(limit**0.5 * (1 + 1e-9), output_type="ndarray")
    return components(len(places), within(places, near, limit, "xy"))[place_of]


def proximity(
    points: Steps, distance: float, scale: float = 1.0, metric: str = "xyz", edges: Pairs | None = None
) -> Labels:
    """Components of the Delaunay edges within the distance; `edges` between the sorted places stand in for scipy's."""
    places, place_of = np.unique(points[:, :2], axis=0, return_inverse=True)
    if edges is None:
        edges = triangulate(places)
    neighbors = at_places(np.concatenate([edges, own_places(len(places))]), place_of)
    return components(len(points), within(points, neighbors, squared_limit(distance, scale), metric))


def own_places(count: int) -> Pairs:
    return np.repeat(np.arange(count)[:, None], 2, axis=1)


def at_places(edges: Pairs, place_of: NDArray[np.int64]) -> Pairs:
    """Pair each point at one end of an edge with each point at the other."""
    by_place = np.argsort(place_of, kind="stable")
    heights = np.bincount(place_of)
    start = np.cumsum(heights) - heights
    sizes = heights[edges].prod(axis=1)
    edge = np.repeat(np.arange(len(edges)), sizes)
    nth = np.arange(len(edge)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    a, b = edges[edge].T
    return np.column_stack([by_place[start[a] + nth // heights[b]], by_place[start[b] + nth % heights[b]]])


def triangulate(places: Steps) -> Pairs:
    """Delaunay edges by Qhull, for places in general position."""
    triangulation = Delaunay(places - places.min(axis=0))
    assert len(triangulation.coplanar) == 0, "Qhull has left places out"
    return np.concatenate([triangulation.simplices[:, list(side)] for side in ((0, 1), (1, 2), (2, 0))])


def sure_and_possible_edges(places: Steps) -> tuple[Pairs, Pairs]:
    """Edges of every, and of any, Delaunay triangulation, in exact arithmetic and cubic time.

    An edge is in a Delaunay triangulation if a circle through its ends holds no other place inside, and in every one if
    such a circle has none on it either. The circle's center lies on the bisector, at middle + t · normal; each place to
    the left bounds t from above, each to the right from below.
    """
    sure, possible = [], []
    for a, b in combinations(range(len(places)), 2):
        interval = empty_circles(places, a, b)
        if interval is None:
            continue
        low, high = interval
        if low is None or high is None or low < high:
            sure.append((a, b))
        if low is None or high is None or low <= high:
            possible.append((a, b))
    return np.array(sure, np.int64).reshape(-1, 2), np.array(possible, np.int64).reshape(-1, 2)


def empty_circles(places: Steps, a: int, b: int) -> tuple[Fraction | None, Fraction | None] | None:
    """Bounds of t for which the circle through two places is empty; none if a place lies between them."""
    ax, ay = (int(v) for v in places[a])
    dx, dy = int(places[b][0]) - ax, int(places[b][1]) - ay
    low: Fraction | None = None
    high: Fraction | None = None
    for c in range(len(places)):
        if c in (a, b):
            continue
        cx, cy = int(places[c][0]) - ax, int(places[c][1]) - ay
        left = dx * cy - dy * cx
        # |c − center|² ≥ |a − center|², for center = (d / 2) + t · (−dy, dx).
        free = cx * cx + cy * cy - cx * dx - cy * dy
        if left == 0:
            if free < 0:
                return None
        elif left > 0:
            bound = Fraction(free, 2 * left)
            high = bound if high is None else min(high, bound)
        else:
            bound = Fraction(free, 2 * left)
            low = bound if low is None else max(low, bound)
    return low, high
