"""Plane extraction by its definition: every plane adjusted from scratch by NumPy, every distance computed anew."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEWEST_POINTS = 5
GROWTH = 1.25


class Plane(NamedTuple):
    """A plane and the points that it was adjusted to."""

    center: Floats
    normal: Floats
    sigma0: float

    def distances(self, points: Floats) -> Floats:
        """How far points lie from it."""
        return np.abs((points - self.center) @ self.normal)


def adjust(points: Floats) -> Plane | None:
    """Least squares; None where there is no one plane."""
    if len(points) < 3:
        return None
    center = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - center)
    if spread[1] ** 2 <= 1e-12 * spread[0] ** 2:
        return None
    thickness = spread[2] if len(spread) > 2 else 0.0
    sigma0 = np.sqrt(thickness**2 / (len(points) - 3)) if len(points) > 3 else 0.0
    return Plane(center, axes[2], float(sigma0))


class Extraction(NamedTuple):
    """A cloud and what planes are extracted by."""

    points: Floats
    normals: Floats
    sigmas: Floats
    weights: Floats
    radius: float
    max_distance: float
    max_sigma: float
    min_angle_deg: float
    tile_size: float

    def labels(self) -> NDArray[np.int64]:
        """One label per point."""
        tiles = np.floor(self.points[:, :2] / self.tile_size).astype(int)
        patches: list[tuple[Plane, list[int], set[int]]] = []
        patch_of = np.full(len(self.points), -1)
        for tile in sorted({(int(x), int(y)) for x, y in tiles}):
            own = (tiles == tile).all(axis=1)
            for plane, members in self.in_tile(tile, own):
                for inside in self.pieces({i for i in members if own[i]}):
                    patch_of[list(inside)] = len(patches)
                    patches.append((plane, members, inside))
        return self.joined(patches, patch_of)

    def neighbors(self, point: int) -> list[int]:
        """Near ones first, then by point id."""
        squared = ((self.points - self.points[point]) ** 2).sum(axis=1)
        near = np.flatnonzero(squared <= self.radius**2)
        order = sorted(near, key=lambda i: (squared[i], i != point, i))
        return [int(i) for i in order]

    def pieces(self, inside: set[int]) -> list[set[int]]:
        """What of these points holds together through neighbors."""
        pieces: list[set[int]] = []
        for point in inside:
            near = set(self.neighbors(point)) & inside
            touched = [piece for piece in pieces if piece & near]
            pieces = [piece for piece in pieces if not piece & near]
            pieces.append(near.union(*touched))
        return pieces

    def fits(self, point: int, plane: Plane) -> bool:
        """Whether the point may join."""
        with np.errstate(invalid="ignore"):
            angle = np.degrees(np.arccos(np.minimum(abs(self.normals[point] @ plane.normal), 1.0)))
            limit = np.fmax(np.degrees(2 * np.arctan(self.sigmas[point])), self.min_angle_deg)
            return bool(angle <= limit + 1e-9 and plane.distances(self.points[point]) < self.max_distance)

    def in_tile(self, tile: tuple[int, int], own: NDArray[np.bool_]) -> list[tuple[Plane, list[int]]]:
        """Grow the planes of a tile and its margin."""
        low = np.array(tile) * self.tile_size - 2 * self.radius
        high = (np.array(tile) + 1) * self.tile_size + 2 * self.radius
        place = self.points[:, :2]
        free = own | ((low <= place) & (place < high)).all(axis=1)
        takes_part = free.copy()
        waiting = {int(i) for i in np.flatnonzero(free & ~np.isnan(self.weights))}
        patches = []
        while open_seeds := [i for i in waiting if free[i]]:
            seed = min(open_seeds, key=lambda i: (self.weights[i], i))
            waiting.discard(seed)
            grown = self.grow(seed, free, takes_part)
            if grown is not None:
                free[grown[1]] = False
                patches.append(grown)
        return patches

    def grow(self, seed: int, free: NDArray[np.bool_], takes_part: NDArray[np.bool_]) -> tuple[Plane, list[int]] | None:
        """Grow one plane, and settle what belongs to it."""
        around = [i for i in self.neighbors(seed) if takes_part[i]]
        plane = Plane(self.points[around].mean(axis=0), self.normals[seed], 0.0)
        if not self.fits(seed, plane):
            return None
        members: list[int] = []
        due = max(GROWTH * len(around), 3)
        adjusted = 0
        popped = -1
        queue = [seed]
        while True:
            for i in queue:
                if not free[i] or i in members or not self.fits(i, plane):
                    continue
                members.append(i)
                if len(members) >= due:
                    plane, adjusted = self.readjusted(members, plane, adjusted)
                    due = GROWTH * len(members)
            popped += 1
            if popped == len(members):
                break
            queue = self.neighbors(members[popped])
        plane, adjusted = self.readjusted(members, plane, adjusted)
        return self.settled(members[:adjusted], plane)

    def readjusted(self, members: list[int], plane: Plane, adjusted: int) -> tuple[Plane, int]:
        """Adjust the plane to its members if that fits well enough."""
        new = adjust(self.points[members])
        return (new, len(members)) if new is not None and new.sigma0 < self.max_sigma else (plane, adjusted)

    def settled(self, members: list[int], plane: Plane) -> tuple[Plane, list[int]] | None:
        """Release what is far from the plane until nothing is."""
        while True:
            near = [i for i in members if plane.distances(self.points[i]) < self.max_distance]
            if len(near) == len(members):
                break
            members, new = near, adjust(self.points[near])
            if new is None:
                return None
            plane = new
        return (plane, members) if len(members) >= FEWEST_POINTS and plane.sigma0 < self.max_sigma else None

    def joined(
        self, patches: list[tuple[Plane, list[int], set[int]]], patch_of: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Make patches one that share a point next to both and agree."""
        label = np.arange(len(patches))
        for (a, (_, members, inside)), point in product(enumerate(patches), range(len(self.points))):
            b = patch_of[point]
            shares = b not in (-1, a) and point in members and any(i in inside for i in self.neighbors(point))
            if shares and self.agree(patches[a], patches[b]):
                label[label == label[b]] = label[a]
        return np.array([-1 if i == -1 else label[i] for i in patch_of])

    def agree(self, a: tuple[Plane, list[int], set[int]], b: tuple[Plane, list[int], set[int]]) -> bool:
        """Whether the planes are coplanar."""

        def fits(small: tuple[Plane, list[int], set[int]], large: tuple[Plane, list[int], set[int]]) -> bool:
            deviation = np.sqrt(np.mean(large[0].distances(self.points[small[1]]) ** 2))
            return len(small[1]) > len(large[1]) or bool(deviation < self.max_sigma)

        cosine = abs(float(a[0].normal @ b[0].normal))
        return cosine >= np.cos(np.radians(self.min_angle_deg)) and fits(a, b) and fits(b, a)
