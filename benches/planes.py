"""Roofs as planes: the plane examples of OPALS' segmentation module on an airborne city, and a picture.

    python benches/planes.py [--out DIR] [--widths 10 20 50]

The cloud is delft_ahn3.laz (16 points/m², row houses on a canal). Each plane's sigma0 is computed by NumPy from the
labelled points, not taken from the segmentor. Results that came out: `BENCHMARKS.md`.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

import streamseg as ss
from measuring import DATA

BUILDING = 6
SHARE = 0.80
SIGMA = 0.05

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]

# OPALS' third example (railway): a very basic use; radius 0.5, its limits.
BASIC = ss.PlaneExtraction(0.5, max_distance=0.15, max_sigma=0.1, min_segment_size=200)
# Its fourth: roofs within a region, seeds above the ground. Z > 275 m there is Z > 2 m here.
ROOFS_OF_A_REGION = ss.PlaneExtraction(
    1.0,
    max_distance=0.2,
    max_sigma=0.15,
    seed_calculator="NormalSigma0 < 0.02 AND Z > 2 ? NormalSigma0 : invalid",
    filter="Region[84850 447450 84950 447450 84950 447600 84850 447600]",
    min_segment_size=50,
)
# Every roof. Tiles, dormers and edges make normals of few points rough, so angles are wide and distances decide.
ROOFS = ss.PlaneExtraction(
    1.0,
    k=12,
    max_distance=0.15,
    min_angle_deg=35.0,
    seed_calculator="NormalSigma0 < 0.05 ? NormalSigma0 : invalid",
    min_segment_size=20,
)


class Planes(NamedTuple):
    """The planes of a labelled cloud, by independent computation."""

    labels: Ids
    sizes: Ids
    sigmas: Floats
    of_point: Floats
    """sigma0 of each point's plane; infinite without one."""


def measure(points: Floats, labels: Ids) -> Planes:
    """Adjust a plane to the points of each label."""
    inside = labels != -1
    names, number, sizes = np.unique(labels[inside], return_inverse=True, return_counts=True)
    near = points[inside] - points.mean(axis=0)
    centers = np.column_stack([np.bincount(number, column) for column in near.T]) / sizes[:, None]
    near -= centers[number]
    products = [np.bincount(number, near[:, i] * near[:, j]) / sizes for i in range(3) for j in range(3)]
    smallest = np.linalg.eigvalsh(np.stack(products, axis=1).reshape(-1, 3, 3))[:, 0]
    sigmas = np.sqrt(np.maximum(smallest, 0) * sizes / np.maximum(sizes - 3, 1))
    of_point = np.full(len(labels), np.inf)
    of_point[inside] = sigmas[number]
    return Planes(names, sizes, sigmas, of_point)


def report(title: str, cloud: laspy.LasData, labels: Ids) -> float:
    """Print what came out; return the share of roof points in even planes."""
    points = np.asarray(cloud.xyz)
    planes = measure(points, labels)
    roofs = np.asarray(cloud.classification) == BUILDING
    share = float((planes.of_point[roofs] < SIGMA).mean())
    print(
        f"{title}: {len(planes.labels)} planes of {planes.sizes.sum()} points,"
        f" sigma0 median {np.median(planes.sigmas):.3f} m, largest {planes.sigmas.max():.3f} m;"
        f" {share:.1%} of class {BUILDING} in planes with sigma0 < {SIGMA} m"
    )
    return share


def draw(path: Path, cloud: laspy.LasData, labels: Ids) -> None:
    """Draw the roofs in plan view, each plane in a color of its own; points without one in black."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    roofs = np.asarray(cloud.classification) == BUILDING
    points, of = np.asarray(cloud.xyz)[roofs], labels[roofs]
    order = np.argsort(points[:, 2])
    points, of = points[order], of[order]
    colors = np.random.default_rng(4).uniform(0.25, 1.0, (of.max() + 2, 3))
    colors[0] = 0.0
    figure = plt.figure(figsize=(14, 16), layout="constrained")
    axes = figure.add_subplot(aspect="equal", title=f"{path.stem}: {len(np.unique(of)) - 1} planes")
    axes.scatter(points[:, 0], points[:, 1], s=1.5, c=colors[of + 1], linewidths=0)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder for the pictures")
    parser.add_argument("--widths", type=float, nargs="*", default=[10.0, 20.0, 50.0])
    options = parser.parse_args()
    path = DATA / "als" / "delft_ahn3.laz"
    cloud = laspy.read(path)
    for name, segmentor in [("basic", BASIC), ("region", ROOFS_OF_A_REGION), ("roofs", ROOFS)]:
        begun = time.perf_counter()
        labels = ss.segment_static(path, segmentor)
        seconds = time.perf_counter() - begun
        print(segmentor)
        share = report(f"  static, {seconds:.1f} s", cloud, labels)
        if options.out:
            options.out.mkdir(parents=True, exist_ok=True)
            draw(options.out / f"planes-{name}.png", cloud, labels)
        for width in options.widths if segmentor is ROOFS else []:
            begun = time.perf_counter()
            streamed = ss.segment(path, segmentor, spans=ss.SpanByWidth(width), window=ss.Window(3, 1))
            seconds = time.perf_counter() - begun
            inside = labels != -1
            agreement = adjusted_rand_score(labels[inside], streamed[inside])
            report(f"  spans of {width} m, {seconds:.1f} s, adjusted Rand index {agreement:.4f}", cloud, streamed)
    assert share >= SHARE, f"only {share:.1%} of the roofs' points are in even planes"


if __name__ == "__main__":
    main()
