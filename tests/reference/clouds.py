"""Measured clouds as they are stored."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from numpy.typing import NDArray


class LatticeCloud(NamedTuple):
    """A LAS file, read with laspy."""

    path: Path
    points: NDArray[np.int64]
    """Steps of the lattice, (n, 3)."""
    scale: float
    """Units per step, the same on all axes."""


def read(path: Path) -> LatticeCloud:
    """Read a file whose axes have the same scale."""
    las = laspy.read(path)
    assert len(set(las.header.scales)) == 1, f"{path} has scales {las.header.scales}"
    points = np.column_stack([las.X, las.Y, las.Z]).astype(np.int64)
    return LatticeCloud(path, points, float(las.header.scales[0]))
