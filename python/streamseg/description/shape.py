"""What a sample looks like: how far points are apart, what lies above what, how even the surfaces are."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..features import features

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .sample import Blocks

# The neighbor whose distance is called the spacing. The nearest may be another echo of the same pulse.
_NEIGHBOR = 4

# Neighbors that a plane is fitted to, the point itself included.
K = 16

# Up to this surface variation a neighborhood is a piece of surface rather than a heap of points.
_SMOOTH = 0.02

# A point lies above another if it is nearer on the map than their spacing, and higher by so many spacings.
_HIGHER = 5

# Points around each seed whose neighbors are looked at.
_QUERIES = 100


class Shape(NamedTuple):
    """What a sample looks like.

    spacing, on_the_map : median distance to the fourth nearest point, in space and with x and y alone
    layered : share of points with others above or below them
    smooth : share of points whose neighborhood is a piece of surface
    noise : median distance of the points of smooth neighborhoods from their planes; None if none is smooth
    up : 0 or 1 if up seems to be x or y; None if nothing speaks against z
    flat : the axis along which the cloud has no extent to speak of, if it is one surface
    """

    spacing: float
    on_the_map: float
    layered: float
    smooth: float
    noise: float | None
    up: int | None
    flat: int | None


def shape_of(blocks: Blocks, extent: NDArray[np.float64]) -> Shape:
    """Measure a sample of a cloud that reaches so far along x, y and z."""
    spacing, on_the_map, layered = _distances(blocks)
    found = features(blocks.points, ["SurfaceVariation", "NormalSigma0", "NormalX", "NormalY", "NormalZ"], k=K)
    is_smooth = found["SurfaceVariation"] <= _SMOOTH
    is_smooth &= np.isfinite(found["NormalSigma0"])
    noise = float(np.median(found["NormalSigma0"][is_smooth])) if is_smooth.any() else None
    facing = [_facing(found[f"Normal{axis}"][is_smooth]) for axis in "XYZ"]
    smooth = float(np.mean(is_smooth))
    up, flat = _up(facing, extent, smooth), _flat(facing, extent, smooth)
    return Shape(spacing, on_the_map, layered, smooth, noise, up, flat)


def _facing(components: NDArray[np.float64]) -> float:
    """Share of the normals that are within 20 degrees of an axis."""
    return float(np.mean(np.abs(components) > np.cos(np.radians(20)))) if len(components) else 0.0


def _distances(blocks: Blocks) -> tuple[float, float, float]:
    """Look at the neighbors of some points: spacing in space and on the map, and the share with layers."""
    in_space, on_map, is_layered = [], [], []
    for around in blocks.around:
        own = blocks.points[around]
        # Around points in the outer part of a ball others are missing.
        inner = len(own) if len(own) == len(blocks.points) else len(own) // 4
        queries = own[np.unique(np.linspace(0, inner - 1, _QUERIES).astype(np.int64))]
        squares = (own[None, :, :] - queries[:, None, :]) ** 2
        map_squares = squares[:, :, 0] + squares[:, :, 1]
        nearest = np.partition(map_squares + squares[:, :, 2], _NEIGHBOR, axis=1)[:, _NEIGHBOR]
        in_space.append(np.sqrt(nearest))
        on_map.append(np.sqrt(np.partition(map_squares, _NEIGHBOR, axis=1)[:, _NEIGHBOR]))
        is_near = map_squares <= nearest[:, None]
        is_layered.append((is_near & (squares[:, :, 2] > _HIGHER**2 * nearest[:, None])).any(axis=1))
    return (
        float(np.median(np.concatenate(in_space))),
        float(np.median(np.concatenate(on_map))),
        float(np.mean(np.concatenate(is_layered))),
    )


def _up(facing: Sequence[float], extent: NDArray[np.float64], smooth: float) -> int | None:
    """Tell which other axis than z is up: floors and ceilings face it, and rooms are lower than they are wide."""
    up = int(np.argmin(extent))
    is_clear = smooth > 0.5 and facing[up] > 1.1 * max(*facing[:up], *facing[up + 1 :])
    has_walls = sum(facing) - facing[up] > 0.1
    return up if up < 2 and is_clear and has_walls else None


def _flat(facing: Sequence[float], extent: NDArray[np.float64], smooth: float) -> int | None:
    """Tell along which axis a cloud that is one surface has next to no extent."""
    axis = int(np.argmin(extent))
    rest = np.delete(extent, axis).min()
    return axis if extent[axis] < rest / 20 and facing[axis] > 0.9 and smooth > 0.5 else None
