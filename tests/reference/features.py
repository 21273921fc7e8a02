"""Features of points, neighborhood by neighborhood with NumPy's own decompositions.

Neighbors are ordered as the core orders them, by distance in whole lattice steps and then by number; all else is done
another way: planes by singular values of the offsets, quadrics by `lstsq` from the point itself, principal curvatures
as eigenvalues of the shape operator.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Reals = NDArray[np.float64]
Numbers = NDArray[np.int64]

# Relative to the largest: where the smaller eigenvalues are no farther apart, rounding turns the normal by more than
# 1e-10, and, in a neighborhood so long and narrow, curvatures by more than 1e-9.
APART = 1e-6
WIDE = 1e-4

PLANE = [
    "NormalX",
    "NormalY",
    "NormalZ",
    "NormalSigma0",
    "NormalEigenvalue1",
    "NormalEigenvalue2",
    "NormalEigenvalue3",
    "Linearity",
    "Planarity",
    "Sphericity",
    "Omnivariance",
    "Anisotropy",
    "Eigenentropy",
    "SurfaceVariation",
    "Verticality",
    "NeighborCount",
]
CURVATURE = ["MeanCurvature", "GaussianCurvature", "MaxCurvature", "MinCurvature"]


class Twin(NamedTuple):
    """Features of one point, and how well they are determined."""

    values: dict[str, float]
    spread: float
    """Largest standard deviation of the neighbors."""
    is_apart: bool
    """Whether the normal is determined."""
    is_wide: bool
    """Whether curvatures are determined as well as the normal."""
    pivot: float
    """How far the least independent term of a quadric is from the others; the core's limit is 1e-6."""


def nearest(points: NDArray[Any], queries: Iterable[int], k: int, axes: int = 3) -> Iterator[Numbers]:
    """Yield the k nearest of each query, itself first, then by (distance, number)."""
    tree = cKDTree(points[:, :axes])
    for query in queries:
        far = np.max(tree.query(points[query, :axes], min(k, len(points)))[0])
        near = np.array(tree.query_ball_point(points[query, :axes], far * (1 + 1e-9)), np.int64)
        yield _ordered(points, query, near, axes)[0][:k]


def around(
    points: NDArray[Any],
    queries: Iterable[int],
    radius: float,
    axes: int = 3,
    low: float = -np.inf,
    high: float = np.inf,
) -> Iterator[Numbers]:
    """Yield all points within a radius, and `low` to `high` above, in the order of `nearest`; all lengths in steps."""
    tree = cKDTree(points[:, :axes])
    for query in queries:
        near = np.array(tree.query_ball_point(points[query, :axes], radius * (1 + 1e-9)), np.int64)
        above = points[near, 2] - points[query, 2]
        ordered, squared = _ordered(points, query, near[(low <= above) & (above <= high)], axes)
        yield ordered[squared <= radius * radius]


def _ordered(points: Reals, query: int, near: Numbers, axes: int) -> tuple[Numbers, Reals]:
    squared = ((points[near, :axes] - points[query, :axes]) ** 2).sum(axis=1)
    order = np.lexsort((near, near != query, squared))
    return near[order], squared[order]


def features(offsets: Reals) -> Twin:
    """Features of a point whose neighbors are at these offsets from it, (n, 3)."""
    n = len(offsets)
    values = dict.fromkeys([*PLANE, *CURVATURE], np.nan)
    values["NeighborCount"] = n
    if n < 3:
        return Twin(values, 0.0, False, False, 0.0)
    mean = offsets.mean(axis=0)
    singular, axes = np.linalg.svd(offsets - mean, full_matrices=True)[1:]
    a, b, c = eigenvalues = singular**2 / n
    values |= zip(("NormalEigenvalue1", "NormalEigenvalue2", "NormalEigenvalue3"), eigenvalues, strict=True)
    values["SurfaceVariation"] = c / (a + b + c) if a > 0 else 0.0
    if a > 0:
        share = eigenvalues / (a + b + c)
        values |= {
            "Linearity": (a - b) / a,
            "Planarity": (b - c) / a,
            "Sphericity": c / a,
            "Anisotropy": (a - c) / a,
            "Omnivariance": np.cbrt(a * b * c),
            "Eigenentropy": -np.sum(share[share > 0] * np.log(share[share > 0])),
        }
    if b <= 1e-12 * a:
        return Twin(values, a**0.5, False, False, 0.0)
    normal = upward(axes[2])
    values |= zip(("NormalX", "NormalY", "NormalZ"), normal, strict=True)
    values["Verticality"] = 1 - abs(normal[2])
    values["NormalSigma0"] = np.sqrt(n * c / (n - 3)) if n > 3 else 0.0
    pivot = independence((offsets - mean) @ axes[:2].T / np.sqrt(eigenvalues[:2])) if n >= 6 else 0.0
    if pivot > 1e-6:
        values |= zip(CURVATURE, curvatures(offsets, np.array([axes[0], axes[1], normal])), strict=True)
    return Twin(values, a**0.5, bool(b - c > APART * a), bool(b - c > WIDE * a), pivot)


def upward(normal: Reals) -> Reals:
    """Turn a normal to z > 0, else y > 0, else x > 0; what is below 1e-12 is 0."""
    normal = np.where(np.abs(normal) < 1e-12, 0.0, normal)
    leading = [c for c in normal[::-1] if c != 0]
    return normal * np.sign(leading[0])


def design(xy: Reals) -> Reals:
    """Terms of a quadric height field, (n, 6)."""
    x, y = xy.T
    return np.column_stack([np.ones(len(xy)), x, y, x * x, x * y, y * y])


def independence(xy: Reals) -> float:
    """Tell what the least independent term keeps of its sum of squares when the terms before it are taken out."""
    terms = design(xy)
    whole = (terms**2).sum(axis=0)
    kept = np.diag(np.linalg.qr(terms, mode="r")) ** 2
    return float(np.min(kept / np.where(whole > 0, whole, np.inf)))


def curvatures(offsets: Reals, axes: Reals) -> tuple[float, float, float, float]:
    """Return H, K, K₁ and K₂ of the quadric through the neighbors, at the point."""
    radius = np.sqrt((offsets**2).sum(axis=1).max())
    x, y, z = axes @ (offsets.T / radius)
    _, b, c, d, e, f = np.linalg.lstsq(design(np.column_stack([x, y])), z, rcond=None)[0]
    first = np.array([[1 + b * b, b * c], [b * c, 1 + c * c]])
    second = np.array([[2 * d, e], [e, 2 * f]]) / np.sqrt(1 + b * b + c * c) / radius
    inverse = np.linalg.inv(np.linalg.cholesky(first))
    shape = inverse @ second @ inverse.T
    smaller, greater = np.linalg.eigvalsh(shape)
    return (greater + smaller) / 2, greater * smaller, greater, smaller
