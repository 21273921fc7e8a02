"""Any function of the window is a segmentor, and so is any clusterer of scikit-learn."""

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

import streamseg as ss

strip = ss.scenes.columns("airborne", 30_000, seed=5)


def above_ground(window: ss.WindowPoints) -> NDArray[np.int64]:
    """Cluster what stands more than 2 m above the lowest point of its 10 m cell; the ground gets no segment."""
    points = window.points
    cells = np.unique((points[:, :2] // 10).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    lowest = np.full(cells.max() + 1, np.inf)
    np.minimum.at(lowest, cells, points[:, 2])
    stands = points[:, 2] - lowest[cells] > 2.0
    labels = np.full(len(points), -1, np.int64)
    if stands.any():
        labels[stands] = DBSCAN(eps=1.5, min_samples=5).fit_predict(points[stands])
    return labels


labels = ss.segment(strip["xyz"], above_ground, spans=ss.SpanByWidth(15.0))
sizes = np.bincount(labels[labels > 0])
print(f"{np.count_nonzero(sizes)} things stand on the ground, the largest has {sizes.max():,} points")
