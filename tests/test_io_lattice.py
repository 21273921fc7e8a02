"""The lattice several files share: exact where it can be, and said where it cannot."""

from __future__ import annotations

import warnings
from fractions import Fraction
from typing import TYPE_CHECKING

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamseg.errors import StreamsegWarning
from streamseg.io import Lattice, open_cloud
from streamseg.io.lattice import common_lattice

if TYPE_CHECKING:
    from pathlib import Path

SCALES = st.sampled_from([0.01, 0.001, 0.0005, 0.00025, 0.1, 1.0, 0.02, 0.025])
OFFSETS = st.integers(-4000, 4000).map(lambda steps: steps / 4)


@given(st.lists(st.tuples(SCALES, OFFSETS), min_size=1, max_size=4), st.integers(-(2**31), 2**31 - 1))
def test_decimal_scales_and_offsets_are_matched_exactly(files: list[tuple[float, float]], step: int) -> None:
    lattices = [Lattice((scale,) * 3, (offset,) * 3) for scale, offset in files]
    common, shifts = common_lattice(lattices)
    for lattice, shift in zip(lattices, shifts, strict=True):
        points = np.full((1, 3), float(step))
        shift.apply(points)
        assert shift.exact
        assert points[0, 0] == np.rint(points[0, 0])
        was = Fraction(str(lattice.scale[0])) * step + Fraction(str(lattice.offset[0]))
        now = Fraction(str(common.scale[0])) * int(points[0, 0]) + Fraction(str(common.offset[0]))
        assert now == was


def test_one_file_keeps_its_own_lattice() -> None:
    lattice = Lattice((0.01, 0.02, 0.003), (391867.67992589, -0.0, 1e7))
    common, (shift,) = common_lattice([lattice])
    assert common == lattice
    assert shift.is_identity


def test_offsets_a_hair_beside_whole_steps_count_as_whole() -> None:
    common, shifts = common_lattice([Lattice((0.01,) * 3), Lattice((0.01,) * 3, (0.30000000000000004, 0.0, 1e-9))])
    assert common == Lattice((0.01,) * 3)
    assert shifts[1].exact
    assert shifts[1].steps == (30.0, 0.0, 0.0)


def test_what_cannot_be_matched_is_rounded_and_said(tmp_path: Path) -> None:
    for name, offset in (("a.las", 0.0), ("b.las", 1 / 3), ("c.las", 1 / 3)):
        header = laspy.LasHeader(point_format=0)
        header.scales, header.offsets = np.full(3, 0.01), np.array([offset, 0.0, 0.0])
        las = laspy.LasData(header)
        las.X = np.arange(100)
        las.write(str(tmp_path / name))
    with pytest.warns(StreamsegWarning, match=r"b\.las does not lie on the lattice of a\.las: .* rounded"):
        cloud = open_cloud([tmp_path / "a.las", tmp_path / "b.las"])
    first, second = (chunk.points for chunk in cloud.chunks())
    assert np.array_equal(first[:, 0], np.arange(100))
    assert np.array_equal(second[:, 0], np.arange(100) + 33)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        open_cloud([tmp_path / "b.las", tmp_path / "c.las"])
