"""The grid of integer steps on which a file stores its coordinates, and the one grid that several files share.

LAS stores ``X`` and means ``X * scale + offset``. Distances are decided on the integers, where they are exact, so
all files of a stream must count in the same steps. `common_lattice` picks these, per axis:

1. the finest scale of the files at the first file's offset, when every other scale is a whole multiple of it and
   every offset a whole number of steps away (within 1e-6 step): integer shifts and factors, exact;
2. else the greatest common divisor of all scales and offset differences, written as decimals, as long as it is at
   most 100 times finer than the finest scale: exact too;
3. else the finest scale at the first file's offset: coordinates are rounded to the nearest step, which moves a
   point by at most half a step, and a warning says so.
"""

from __future__ import annotations

from fractions import Fraction
from math import gcd
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Triple = tuple[float, float, float]

_STEP_TOLERANCE = 1e-6
_FACTOR_TOLERANCE = 1e-9
_FINEST_DIVISION = 100


class Lattice(NamedTuple):
    """Steps per axis: a coordinate is ``step * scale + offset``, in the units of the file."""

    scale: Triple = (1.0, 1.0, 1.0)
    offset: Triple = (0.0, 0.0, 0.0)

    @property
    def is_identity(self) -> bool:
        """Whether lattice units are the coordinates themselves."""
        return self == Lattice()

    def to_coordinates(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn ``(n, 3)`` float64 lattice units into ``(n, 3)`` float64 coordinates."""
        if self.is_identity:
            return points
        scaled: NDArray[np.float64] = points * np.asarray(self.scale)
        scaled += np.asarray(self.offset)
        return scaled


class Shift(NamedTuple):
    """How one file's lattice units become the common ones: ``units * factor + steps``, rounded unless exact."""

    factor: Triple = (1.0, 1.0, 1.0)
    steps: Triple = (0.0, 0.0, 0.0)
    exact: bool = True

    @property
    def is_identity(self) -> bool:
        """Whether nothing has to be done."""
        return self == Shift()

    def apply(self, points: NDArray[np.float64]) -> None:
        """Move ``(n, 3)`` float64 points onto the common lattice, in place."""
        if self.is_identity:
            return
        points *= np.asarray(self.factor)
        points += np.asarray(self.steps)
        if not self.exact:
            np.rint(points, out=points)


class _Axis(NamedTuple):
    scale: float
    factors: list[float]
    steps: list[float]
    exact: list[bool]


def common_lattice(lattices: Sequence[Lattice]) -> tuple[Lattice, list[Shift]]:
    """Find the lattice all files can be put on, and each file's way onto it.

    Parameters
    ----------
    lattices : sequence of Lattice
        One per file, in the order of the stream; at least one.

    Returns
    -------
    (Lattice, list of Shift)
        The offset is the first file's; the scale is too, unless another file's is finer.

    Examples
    --------
    >>> coarse, fine = Lattice((0.01,) * 3), Lattice((0.001,) * 3, (5.0, 0.0, 0.0))
    >>> lattice, (first, second) = common_lattice([coarse, fine])
    >>> lattice.scale, first.factor, second.steps
    ((0.001, 0.001, 0.001), (10.0, 10.0, 10.0), (5000.0, 0.0, 0.0))
    """
    axes = [
        _common_axis([lattice.scale[i] for lattice in lattices], [lattice.offset[i] for lattice in lattices])
        for i in range(3)
    ]
    x, y, z = axes
    shifts = [
        Shift(
            (x.factors[i], y.factors[i], z.factors[i]),
            (x.steps[i], y.steps[i], z.steps[i]),
            x.exact[i] and y.exact[i] and z.exact[i],
        )
        for i in range(len(lattices))
    ]
    return Lattice((x.scale, y.scale, z.scale), lattices[0].offset), shifts


def _common_axis(scales: list[float], offsets: list[float]) -> _Axis:
    finest = min(scales)
    factors = [scale / finest for scale in scales]
    steps = [(offset - offsets[0]) / finest for offset in offsets]
    whole = [
        abs(factor - round(factor)) <= _FACTOR_TOLERANCE * factor and abs(step - round(step)) <= _STEP_TOLERANCE
        for factor, step in zip(factors, steps, strict=True)
    ]
    if all(whole):
        return _Axis(finest, [float(round(f)) for f in factors], [float(round(s)) for s in steps], whole)

    # repr() gives back the decimals the writer meant: 0.01 and not 0.01000000000000000020816681711721685…
    exact_scales = [Fraction(repr(scale)) for scale in scales]
    exact_offsets = [Fraction(repr(offset)) - Fraction(repr(offsets[0])) for offset in offsets]
    divisor = _divisor(exact_scales + exact_offsets)
    if divisor * _FINEST_DIVISION >= min(exact_scales):
        return _Axis(
            float(divisor),
            [float(scale / divisor) for scale in exact_scales],
            [float(offset / divisor) for offset in exact_offsets],
            [True] * len(scales),
        )
    return _Axis(
        finest,
        [float(round(f)) if w else f for f, w in zip(factors, whole, strict=True)],
        [float(round(s)) if w else s for s, w in zip(steps, whole, strict=True)],
        whole,
    )


def _divisor(values: list[Fraction]) -> Fraction:
    result = Fraction(0)
    for value in values:
        result = Fraction(
            gcd(result.numerator * value.denominator, value.numerator * result.denominator),
            result.denominator * value.denominator,
        )
    return result
