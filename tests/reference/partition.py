"""Partitions: labels of points that mean nothing but "together" and "apart"; −1 = no part."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.metrics import adjusted_rand_score

Labels = NDArray[np.int64]


def canonical(labels: ArrayLike) -> Labels:
    """Number the parts 0, 1, 2 … in the order in which they first occur; −1 stays."""
    labels = np.asarray(labels, np.int64)
    values, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(first[values != -1])
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    return np.concatenate([np.full(np.count_nonzero(values == -1), -1), number])[inverse].astype(np.int64)


def same(a: ArrayLike, b: ArrayLike) -> bool:
    """Whether two labellings are the same partition."""
    return np.array_equal(canonical(a), canonical(b))


def refines(fine: ArrayLike, coarse: ArrayLike) -> bool:
    """Whether what is together in `fine` is together in `coarse`."""
    fine, coarse = canonical(fine), canonical(coarse)
    return len(np.unique(np.column_stack([fine, coarse]), axis=0)) == len(np.unique(fine))


def agreement(a: ArrayLike, b: ArrayLike) -> float:
    """Adjusted Rand index: 1 for the same partition, about 0 for unrelated ones."""
    return float(adjusted_rand_score(np.asarray(a), np.asarray(b)))
