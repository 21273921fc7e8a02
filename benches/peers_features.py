"""Normals beside Open3D's: the angle between them at every point, k nearest neighbors.

Needs Open3D (pip install open3d), which is in no environment of the project.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import streamseg as ss
from measuring import DATA, load_xyz

CLOUDS = ["isprs/CSite3.laz", "als/delft_ahn3.laz", "als/lidarhd_77050_627755.laz", "spinning/kitti_a.bin"]

# Median angle in degrees.
GREATEST = 0.05

Reals = NDArray[np.float64]


def load(path: Path) -> Reals:
    if path.suffix == ".bin":
        return np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].astype(float)
    return load_xyz(path)


def by_open3d(xyz: Reals, k: int) -> Reals:
    try:
        import open3d as o3d
    except ImportError as error:
        raise SystemExit(f"Open3D cannot be imported ({error}); get it with: pip install open3d") from None
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz - xyz.mean(axis=0)))
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(k))
    return np.asarray(cloud.normals)


def compare(path: Path, k: int) -> None:
    source = path if path.suffix == ".laz" else load(path)
    found = ss.features(source, ["NormalX", "NormalY", "NormalZ"], k=k)
    ours, theirs = np.column_stack(list(found.values())), by_open3d(load(path), k)
    valid = np.isfinite(ours[:, 0])
    # The sine is exact where the cosine has no digits left.
    sine = np.linalg.norm(np.cross(ours[valid], theirs[valid]), axis=1)
    angle = np.degrees(np.arcsin(np.minimum(sine, 1)))
    median, most = np.median(angle), np.percentile(angle, 95)
    met = "met" if median < GREATEST else "MISSED"
    print(f"{path.name:<28} {len(ours):>9,} {np.count_nonzero(~valid):>8,} {median:>9.2g} {most:>9.2g}", end=" ")
    print(f"{np.mean(angle > GREATEST):>9.2%}  (bar: {GREATEST:g}: {met})")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clouds", type=Path, nargs="*", default=[DATA / name for name in CLOUDS])
    parser.add_argument("-k", type=int, default=30, help="nearest neighbors, the point included [default: 30]")
    given = parser.parse_args()
    print(f"{'angle in degrees, k = ' + str(given.k):<28} {'points':>9} {'no value':>8}", end=" ")
    print(f"{'median':>9} {'95 %':>9} {'above':>9}")
    for path in given.clouds:
        compare(path, given.k)


if __name__ == "__main__":
    main()
