"""The four examples of OPALS' segmentation module, on the command line, over the row houses of Delft.

Heights and the region are Delft's; all else is as in the examples (their first identifier is 0, ours is 1).
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
import pytest
from matplotlib.path import Path as Polygon
from numpy.typing import NDArray

import streamseg as ss
from reference.conditional import clusters, near
from reference.partition import same
from reference.sizes import Limits

NORMALS = ("NormalX", "NormalY", "NormalZ")
REGION = [(84810.5, 447430), (84842.5, 447425), (84840.5, 447600), (84830, 447560), (84812.5, 447620)]


class Segmented(NamedTuple):
    """A labelled file."""

    path: Path
    steps: NDArray[np.int64]
    xyz: NDArray[np.float64]
    ids: NDArray[np.int64]

    @property
    def sizes(self) -> NDArray[np.int64]:
        return np.bincount(self.ids[self.ids > 0])[np.unique(self.ids[self.ids > 0])]


@pytest.fixture(scope="module")
def piece(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The western part of the cloud."""
    las = laspy.read(data / "als" / "delft_ahn3.laz")
    las.points = las.points[las.x < las.x.min() + 35]
    path = tmp_path_factory.mktemp("delft") / "piece.laz"
    las.write(path)
    return path


def segment(source: Path, folder: Path, *options: object) -> Segmented:
    """Run the command line."""
    output = folder / "out.laz"
    command = [sys.executable, "-m", "streamseg", "segment", source, output, *options]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    print(done.stdout)
    las = laspy.read(output)
    steps = np.column_stack([las.X, las.Y, las.Z]).astype(np.int64)
    return Segmented(output, steps, np.asarray(las.xyz), np.asarray(las["SegmentID"], np.int64))


def test_example_1_neighbors_whose_normals_differ_by_less_than_5_degrees(piece: Path, tmp_path: Path) -> None:
    criterion = "normalX*n[0].normalX+normalY*n[0].normalY+normalZ*n[0].normalZ>0.996"
    options = ("--method", "conditional", "--search-radius", 1, "--min-size", 75)
    found = segment(piece, tmp_path, *options, "--criterion", criterion, "--span-width", 10)
    normals = ss.features(piece, NORMALS, search_radius=1.0)
    expected = clusters(
        len(found.ids),
        near(found.steps, 1000),
        normals,
        lambda p, n: p["NormalX"] * n["NormalX"] + p["NormalY"] * n["NormalY"] + p["NormalZ"] * n["NormalZ"] > 0.996,
    )
    assert same(found.ids, Limits(min_segment_size=75).select(expected + 1))
    assert len(found.sizes) > 50


def test_example_2_neighbors_whose_heights_differ_by_less_than_15_cm(piece: Path, tmp_path: Path) -> None:
    options = ("--method", "conditional", "--search-radius", 1, "--min-size", 100)
    found = segment(piece, tmp_path, *options, "--criterion", "abs(Z-n[0].Z)<0.15", "--span-width", 10)
    expected = clusters(
        len(found.ids), near(found.steps, 1000), {"z": found.xyz[:, 2]}, lambda p, n: abs(p["z"] - n["z"]) < 0.15
    )
    assert same(found.ids, Limits(min_segment_size=100).select(expected + 1))
    assert len(found.sizes) > 50


def test_example_3_planes(piece: Path, tmp_path: Path) -> None:
    options = ("--method", "planes", "--search-radius", 0.5, "--min-size", 200)
    found = segment(piece, tmp_path, *options, "--max-distance", 0.15, "--max-sigma", 0.1)
    assert len(found.sizes) > 30
    assert found.sizes.min() >= 200
    spreads = [flatness(found.xyz[found.ids == segment]) for segment in np.unique(found.ids[found.ids > 0])]
    print(f"{len(spreads)} planes, standard deviation {np.median(spreads):.3f} m, at most {max(spreads):.3f} m")
    assert max(spreads) < 0.15


def test_example_4_roofs_in_a_region(piece: Path, tmp_path: Path) -> None:
    corners = " ".join(f"{x} {y}" for x, y in REGION)
    calculator = "NormalSigma0<0.02 AND Z > 3 ? NormalSigma0 : invalid"
    options = ("--method", "planes", "--search-radius", 1, "--min-size", 50, "--max-distance", 0.2, "--max-sigma", 0.15)
    found = segment(piece, tmp_path, *options, "--seed-calculator", calculator, "--filter", f"Region[{corners}]")
    inside = Polygon(REGION).contains_points(found.xyz[:, :2])
    assert 0.1 < inside.mean() < 0.9
    assert np.all(found.ids[~inside] == -1)
    assert len(found.sizes) > 40
    assert found.sizes.min() >= 50
    sigma = ss.features(piece, ["NormalSigma0"], search_radius=1.0)["NormalSigma0"]
    seeds = inside & (found.xyz[:, 2] > 3) & (sigma < 0.02)
    # In the end a plane may let go of what it has moved away from, its seed too.
    assert np.isin(np.unique(found.ids[found.ids > 0]), found.ids[seeds]).mean() > 0.98
    # Roofs: what has been labelled is up there, and flat.
    roofs = found.ids > 0
    assert np.mean(found.xyz[roofs, 2] > 2.5) > 0.95
    spreads = [flatness(found.xyz[found.ids == segment]) for segment in np.unique(found.ids[roofs])]
    assert max(spreads) < 0.2


def test_the_whole_cloud(data: Path, tmp_path: Path) -> None:
    options = ("--method", "conditional", "--search-radius", 1, "--min-size", 100, "--sort", "descending")
    found = segment(data / "als" / "delft_ahn3.laz", tmp_path, *options, "--criterion", "abs(Z-n[0].Z)<0.15")
    assert np.all(np.diff(found.sizes) <= 0)
    assert found.sizes[-1] >= 100
    assert np.mean(found.ids > 0) > 0.8


def flatness(points: NDArray[np.float64]) -> float:
    """Standard deviation of points across their best plane."""
    centered = points - points.mean(axis=0)
    return float(np.sqrt(np.linalg.eigvalsh(centered.T @ centered / len(points))[0].clip(0)))
