"""Roofs as planes: each side of a roof is a segment of its own, here with its slope and how well it fits."""

import numpy as np

import streamseg as ss

strip = ss.scenes.columns("airborne", 100_000, seed=5)
roofs = ss.PlaneExtraction(
    search_radius=1.5,
    k=16,
    max_distance=0.15,
    max_sigma=0.1,
    min_angle_deg=25.0,
    seed_calculator="NormalSigma0 < 0.05 ? NormalSigma0 : invalid",
    filter="Class[Building]",
    min_segment_size=40,
    sort="descending",
)
classes = {"Classification": strip["classification"]}
labels = ss.segment(strip["xyz"], roofs, spans=ss.SpanByWidth(50.0), attributes=classes)

in_planes = np.mean(labels[strip["classification"] == 6] > 0)
print(f"{in_planes:.0%} of the points on buildings lie in {labels.max()} planes; the largest:")
for segment in range(1, 7):
    points = strip["xyz"][labels == segment]
    center = points.mean(axis=0)
    variances, axes = np.linalg.eigh(np.cov((points - center).T))
    slope = np.degrees(np.arccos(abs(axes[2, 0])))
    print(f"{segment:3} {len(points):5} points, slope {slope:4.1f} degrees, sigma {variances[0] ** 0.5:.3f} m")
