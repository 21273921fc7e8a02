"""Conditional clustering, in NumPy: all pairs within reach, the criterion on all of them at once, components."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

Numbers = NDArray[np.float64]
Pairs = NDArray[np.int64]
Labels = NDArray[np.int64]
# Of the attributes at one end of each pair and those at the other: whether the criterion is true.
Criterion = Callable[[Mapping[str, Numbers], Mapping[str, Numbers]], NDArray[np.bool_]]


def near(
    points: NDArray[Any], radius: float, *, flat: bool = False, low: float | None = None, high: float | None = None
) -> Pairs:
    """Pairs (p, n) within the radius, borders included, p < n; in a cylinder those where n is from low to high of p."""
    axes = 2 if flat or low is not None else 3
    pairs = cKDTree(points[:, :axes]).query_pairs(radius * (1 + 1e-9), output_type="ndarray")
    difference = points[pairs[:, 1]] - points[pairs[:, 0]]
    kept = (difference[:, :axes] ** 2).sum(axis=1) <= radius**2
    if low is not None and high is not None:
        kept &= (low <= difference[:, 2]) & (difference[:, 2] <= high)
    return np.asarray(pairs[kept], np.int64)


def components(count: int, pairs: Pairs) -> Labels:
    """Label the components of a graph."""
    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def clusters(count: int, pairs: Pairs, attributes: Mapping[str, ArrayLike], criterion: Criterion) -> Labels:
    """Components of the pairs for which the criterion is true."""
    columns = {name: np.asarray(values, np.float64) for name, values in attributes.items()}
    p, n = ({name: values[pairs[:, end]] for name, values in columns.items()} for end in (0, 1))
    with np.errstate(invalid="ignore"):
        return components(count, pairs[criterion(p, n)])
