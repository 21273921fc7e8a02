"""DBSCAN (Ester et al. 1996) and the radius graph in space on lattice coordinates, decided in whole numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .segmentor import Labels, Pairs, Steps, components, squared_limit, within


def pairs_within(points: Steps, distance: float, scale: float = 1.0, metric: str = "xyz") -> Pairs:
    """All pairs of points within the distance, a pair at exactly the distance included."""
    limit = squared_limit(distance, scale)
    places = (points - points.min(axis=0))[:, : 3 if metric == "xyz" else 2]
    near = cKDTree(places).query_pairs(limit**0.5 * (1 + 1e-9), output_type="ndarray")
    return within(points, near, limit, metric)


def radius(points: Steps, distance: float, scale: float = 1.0, metric: str = "xyz") -> Labels:
    """Components of the radius graph."""
    return components(len(points), pairs_within(points, distance, scale, metric))


class Density(NamedTuple):
    """What DBSCAN finds."""

    is_core: NDArray[np.bool_]
    labels: Labels
    """-1 is noise."""


def dbscan(points: Steps, eps: float, min_points: int, scale: float = 1.0, metric: str = "xyz") -> Density:
    """Join core points; a border point goes with its nearest core point, at equal distance the first."""
    pairs = pairs_within(points, eps, scale, metric)
    is_core = 1 + np.bincount(pairs.ravel(), minlength=len(points)) >= min_points
    of_core = components(len(points), pairs[is_core[pairs].all(axis=1)])
    labels = np.where(is_core, of_core, -1)
    border, core = np.concatenate([pairs, pairs[:, ::-1]])[
        np.concatenate([is_core[pairs[:, 1]], is_core[pairs[:, 0]]])
    ].T
    at_border = ~is_core[border]
    border, core = border[at_border], core[at_border]
    axes = 3 if metric == "xyz" else 2
    squared = ((points[border, :axes] - points[core, :axes]) ** 2).sum(axis=1)
    order = np.lexsort((core, squared, border))
    first = np.unique(border[order], return_index=True)[1]
    nearest = order[first]
    labels[border[nearest]] = of_core[core[nearest]]
    return Density(is_core, labels)
