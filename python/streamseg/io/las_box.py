"""The bounding box in the header of a LAS file: what lies outside is told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

_MOST = 0.5


class Box:
    """The box in steps of the file, with a step to spare.

    Attributes
    ----------
    is_credible : bool
        Whether any point has been found inside.
    """

    def __init__(self, header: Any) -> None:
        with np.errstate(all="ignore"):
            low = (np.asarray(header.mins) - header.offsets) / header.scales - 1
            high = (np.asarray(header.maxs) - header.offsets) / header.scales + 1
        # What is not finite bounds nothing.
        self._low, self._high = np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)
        self.is_credible = False

    def holds(self, steps: NDArray[np.integer[Any]]) -> NDArray[np.bool_]:
        """Tell which of (n, 3) steps lie inside."""
        inside = np.asarray(((steps >= self._low) & (steps <= self._high)).all(axis=1))
        self.is_credible = self.is_credible or bool(inside.any())
        return inside

    def count_outside(self, records: NDArray[np.void]) -> int:
        """Count the records that lie outside."""
        outside = np.zeros(len(records), np.bool_)
        for axis, low, high in zip("XYZ", self._low, self._high, strict=True):
            values = records[axis]
            outside |= (values < low) | (values > high)
        count = int(np.count_nonzero(outside))
        self.is_credible = self.is_credible or count < len(records)
        return count


def outside_sentence(path: Path, outside: int, points: int) -> str:
    """Say how many points lie outside of the box."""
    said = (
        f"{outside:,} of the {points:,} points of {path.name} lie outside of the bounding box in "
        "its header, and are read all the same: "
    )
    if outside > _MOST * points:
        return said + "the box is probably wrong; if not, the file is damaged"
    return said + "stray points, or damage that nothing else tells"
