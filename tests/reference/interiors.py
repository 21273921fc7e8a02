"""Made clouds of what stands upright: a wall, and a room whose up is y, as photogrammetry has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_X, _Y, _Z = np.eye(3)


def wall(noise: float = 0.003) -> NDArray[np.float64]:
    """5 m × 3 m in x and z, a point every 2 cm."""
    points = _face(5.0, 3.0, (0, 0, 0), _X, _Z, step=0.02)
    return points + np.random.default_rng(0).normal(0, noise, points.shape)


def room(noise: float = 0.003) -> NDArray[np.float64]:
    """6 m × 4 m, 2.6 m high along y: six planes, a table, a cupboard and a stool, a point every 4 cm."""
    long, high, wide = 6.0, 2.6, 4.0
    faces = [
        *(_face(long, wide, (0, y, 0), _X, _Z) for y in (0.0, high)),
        *(_face(long, high, (0, 0, z), _X, _Y) for z in (0.0, wide)),
        *(_face(wide, high, (x, 0, 0), _Z, _Y) for x in (0.0, long)),
        *_box((1.0, 0, 1.0), (1.4, 0.75, 0.8)),
        *_box((4.0, 0, 0.3), (0.6, 1.8, 0.9)),
        *_box((2.5, 0, 2.5), (0.45, 0.45, 0.45)),
    ]
    points = np.vstack(faces)
    return points + np.random.default_rng(1).normal(0, noise, points.shape)


def _box(corner: tuple[float, float, float], size: tuple[float, float, float]) -> list[NDArray[np.float64]]:
    """Four sides and the top."""
    at, (x, y, z) = np.array(corner), size
    return [
        _face(x, y, at, _X, _Y),
        _face(x, y, at + z * _Z, _X, _Y),
        _face(z, y, at, _Z, _Y),
        _face(z, y, at + x * _X, _Z, _Y),
        _face(x, z, at + y * _Y, _X, _Z),
    ]


def _face(
    long: float,
    high: float,
    corner: tuple[float, float, float] | NDArray[np.float64],
    along: NDArray[np.float64],
    up: NDArray[np.float64],
    step: float = 0.04,
) -> NDArray[np.float64]:
    a, b = (part.ravel() for part in np.meshgrid(np.arange(0, long, step), np.arange(0, high, step)))
    return np.array(corner) + a[:, None] * along + b[:, None] * up
