"""All segmentors that a contract holds for: ours in every form, and one that a user brings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

import streamseg as ss

Positions = NDArray[np.float64]

SAME_NORMAL = "normalX*n[0].normalX + normalY*n[0].normalY + normalZ*n[0].normalZ > 0.99"


class Promise(NamedTuple):
    """A segmentor and what it promises of spans by width."""

    segmentor: Any
    exactness: str
    is_identical: bool
    """Whether streamed is surely static, where the overlap is at least the reach."""
    reach: float | None
    """How far apart points are looked at together; None = there is no limit, or it is unknown."""
    is_order_free: bool
    """Whether the partition is the same in whatever order the points come."""


ROSTER = {
    "delaunay xyz": Promise(ss.Proximity(1.0), "B", True, 1.0, True),
    "delaunay xy": Promise(ss.Proximity(0.3, metric="xy"), "A", True, 0.3, True),
    "radius xyz": Promise(ss.Proximity(0.6, graph="radius"), "A", True, 0.6, True),
    "radius xy": Promise(ss.Proximity(0.3, graph="radius", metric="xy"), "A", True, 0.3, True),
    "dbscan": Promise(ss.Dbscan(0.75, 6), "B", True, 0.75, True),
    "dbscan xy": Promise(ss.Dbscan(0.5, 6, "xy"), "B", True, 0.5, True),
    "heights": Promise(
        ss.ConditionalClustering("abs(Z - n[0].Z) < 0.2", search_radius=0.7, min_segment_size=1), "A", True, 0.7, True
    ),
    "cylinder": Promise(
        ss.ConditionalClustering(search_radius=(0.5, 0.3), search_mode="2.5d", min_segment_size=1), "A", True, 0.5, True
    ),
    "normals": Promise(
        ss.ConditionalClustering(SAME_NORMAL, search_radius=1.0, min_segment_size=5), "B", True, 1.0, True
    ),
    "downhill": Promise(
        ss.ConditionalClustering("n[0].Z <= Z + 0.02", search_radius=0.7, min_segment_size=1), "C", False, 0.7, False
    ),
    "planes": Promise(
        ss.PlaneExtraction(1.0, max_distance=0.2, max_sigma=0.1, seed_calculator="NormalSigma0", min_segment_size=10),
        "B",
        True,
        1.0,
        True,
    ),
    "growing": Promise(
        ss.RegionGrowing(16, search_radius=1.5, angle_deg=20.0, min_segment_size=5), "B", True, 1.5, True
    ),
    "growing, all in a ball": Promise(
        ss.RegionGrowing(None, search_radius=1.0, angle_deg=15.0, residual=0.2), "B", True, 1.0, True
    ),
    "growing, no limit": Promise(ss.RegionGrowing(16, angle_deg=20.0), "B", False, None, True),
    "growing, principal": Promise(
        ss.RegionGrowing(20, search_radius=2.0, curvature="principal", max_curvature=0.5), "B", True, 2.0, True
    ),
    "growing, literal": Promise(ss.RegionGrowing(16, search_radius=0.75, literal=True), "C", False, 0.75, False),
    "scikit-learn": Promise(DBSCAN(eps=0.75, min_samples=6), "C", False, None, False),
}

OURS = {name: promise for name, promise in ROSTER.items() if isinstance(promise.segmentor, ss.Segmentor)}

# One of each class, to be made without anything but what it needs.
CLASSES: dict[str, Callable[..., Any]] = {
    "proximity": ss.Proximity,
    "dbscan": ss.Dbscan,
    "conditional": ss.ConditionalClustering,
    "planes": ss.PlaneExtraction,
    "growing": ss.RegionGrowing,
}
NEEDED: dict[str, dict[str, Any]] = {"proximity": {"distance": 2.5}, "dbscan": {"eps": 0.5}}
PAGES = {
    "proximity": "proximity",
    "dbscan": "dbscan",
    "conditional": "conditional-clustering",
    "planes": "plane-extraction",
    "growing": "region-growing",
}


def houses(seed: int, count: int = 1500, step: float | None = 0.125) -> Positions:
    """Ground, two-sided roofs above it, and heaps between them, in no order; on a lattice unless `step` is None."""
    random = np.random.default_rng(seed)
    ground = random.uniform((0, 0), (24, 10), (count // 2, 2))
    pieces = [np.column_stack([ground, 0.05 * ground[:, 0]])]
    for east, north in random.uniform((0, 0), (20, 6), (4, 2)):
        roof = random.uniform((0, 0), (4, 4), (count // 10, 2))
        pieces.append(np.column_stack([roof + np.array([east, north]), 5.0 - 0.5 * abs(roof[:, 1] - 2.0)]))
    heaps = random.uniform((0, 0, 1), (24, 10, 4), (6, 3))
    pieces.append((heaps[:, None] + random.normal(0, 0.4, (6, count // 60, 3))).reshape(-1, 3))
    points = np.concatenate(pieces)
    points[:, 2] += random.normal(0, 0.02, len(points))
    points = random.permutation(points)
    return points if step is None else np.round(points / step) * step
