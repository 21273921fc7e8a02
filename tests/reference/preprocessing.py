"""Slow twins of preprocessing, in NumPy and SciPy, after the words of the sources.

The statistical one in the dialect "open3d" was compared with Open3D 0.20 itself, point by point, on four clouds.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Points = NDArray[np.float64]
Dialect = Literal["pcl", "pdal", "open3d"]


def mean_distances(points: Points, k: int, dialect: Dialect) -> Points:
    """Mean distance to the k nearest neighbors, (n,); in the dialect "open3d" the point itself is one of them."""
    others = k - 1 if dialect == "open3d" else k
    others = min(others, len(points) - 1)
    # Relative to the first point, so that all digits are there for the distances.
    tree = cKDTree(points - points[0])
    distances, _ = tree.query(points - points[0], others + 1)
    distances = np.sort(distances.reshape(len(points), -1), axis=1)
    return distances.sum(axis=1) / (others + (dialect == "open3d"))


def statistical_inliers(
    points: Points, k: int, multiplier: float, dialect: Dialect
) -> tuple[NDArray[np.bool_], float, float]:
    """Which points stay, (n,), and mean and standard deviation of the mean distances."""
    d = mean_distances(points, k, dialect)
    mean = d.sum() / len(d)
    counted = d[d > 0] if dialect == "open3d" else d
    deviation = np.sqrt(((counted - mean) ** 2).sum() / (len(d) - 1))
    threshold = mean + multiplier * deviation
    stays = {"pcl": d <= threshold, "pdal": d < threshold, "open3d": (d > 0) & (d < threshold)}[dialect]
    return stays, float(mean), float(deviation)


def radius_inliers(points: Points, radius: float, min_neighbors: int) -> NDArray[np.bool_]:
    """Which points have at least so many others within the radius, (n,)."""
    tree = cKDTree(points - points[0])
    return np.asarray(tree.query_ball_point(points - points[0], radius, return_length=True)) > min_neighbors


def voxels(points: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """The voxel of each point, (n, 3), for a size in whole lattice steps."""
    return np.floor_divide(points, size)


def centroids(points: NDArray[np.int64] | Points, voxel: NDArray[np.int64]) -> tuple[Points, NDArray[np.int64]]:
    """Mean of the points of each voxel, (m, 3), and the voxel's number of each point, (n,)."""
    _, of = np.unique(voxel, axis=0, return_inverse=True)
    of = of.reshape(-1)
    count = of.max(initial=-1) + 1
    corner = np.full((count, 3), np.inf)
    np.minimum.at(corner, of, points)
    sums = np.zeros((count, 3))
    np.add.at(sums, of, points - corner[of])
    return corner + sums / np.bincount(of, minlength=count)[:, None], of


def nearest_to(
    points: NDArray[np.int64] | Points, centers: Points, of: NDArray[np.int64], scale: float
) -> NDArray[np.int64]:
    """The point nearest to the center of its voxel, (m,); of equally near ones the first."""
    d = (points - centers[of]) * scale
    squared = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1] + d[:, 2] * d[:, 2]
    order = np.lexsort((np.arange(len(points)), squared, of))
    first = np.searchsorted(of[order], np.arange(len(centers)))
    return order[first]
