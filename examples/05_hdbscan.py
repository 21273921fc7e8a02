"""HDBSCAN of scikit-learn as a segmentor: in a stream it sees a window at a time, so memory and time stay bounded."""

import time

import numpy as np
from sklearn.cluster import HDBSCAN
from sklearn.metrics import adjusted_rand_score

import streamseg as ss

strip = ss.scenes.columns("airborne", 45_000, seed=5)
standing = strip["xyz"][np.isin(strip["classification"], [5, 6])]  # trees and buildings
hdbscan = HDBSCAN(min_cluster_size=20, copy=True)

start = time.perf_counter()
whole = ss.segment_static(standing, hdbscan)
print(f"at once: {whole.max()} segments of {len(standing):,} points in {time.perf_counter() - start:.1f} s")

# Its time grows with the square of a window's points: spans should be no wider than they have to be. But it is class C:
# what counts as dense depends on all that is in the window, so too narrow ones come to another opinion.
for width in (40.0, 25.0):
    start = time.perf_counter()
    with ss.stream(standing, hdbscan, spans=ss.SpanByWidth(width, "y"), result="final") as stream:
        labels = np.full(len(standing), -1)
        for span in stream:
            labels[span.point_ids] = span.segment_ids
    agreement = adjusted_rand_score(whole, labels)
    print(f"spans of {width} m: adjusted Rand index {agreement:.3f} in {time.perf_counter() - start:.1f} s")
print(f"class {stream.exactness}: {stream.promise}")
