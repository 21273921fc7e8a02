"""Dimensions of LAS points as attributes: what they are called, and what their values mean.

The scan angle is in degrees and has both its names in every point format. Scaled extra dimensions are scaled; where
one has the value that it declares to mean "no data", it has none: NaN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .labels import LAS_SIGN
from .las_records import EXTRA_BYTES, Record, descriptions
from .spelling import letters_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

_SCAN_ANGLE_NAMES = ("scan_angle", "scan_angle_rank")
_FIRST_FORMAT_WITH_STEPS = 6
_STEPS_PER_6_DEGREES = 1000.0
_NO_DATA, _SCALE, _OFFSET = 0b00001, 0b01000, 0b10000
_NO_DATA_AT, _SCALE_AT, _OFFSET_AT, _TEXT_AT = 40, 112, 136, 160


class ExtraDimension(NamedTuple):
    """A dimension that is not in the standard; of bytes that nobody describes, without a description.

    name : what laspy calls it
    dtype : as it is stored, (k,) for several numbers
    description : the 192 bytes that the file has about it
    """

    name: str
    dtype: np.dtype[Any]
    description: bytes | None

    @property
    def meaning(self) -> tuple[Any, ...]:
        """What has to be the same in two files whose values are to mean the same."""
        return self.dtype, self._declared("f8", _SCALE, _SCALE_AT), self._declared("f8", _OFFSET, _OFFSET_AT)

    @property
    def no_data(self) -> tuple[Any, ...] | None:
        """The stored values that mean "no data", one per number."""
        return self._declared(_widest(self.dtype.base), _NO_DATA, _NO_DATA_AT)

    @property
    def holds_ids_of_ours(self) -> bool:
        """Whether an earlier run has written it, whatever it is called."""
        return self.description is not None and self.description[_TEXT_AT:].startswith(LAS_SIGN)

    @property
    def is_numeric(self) -> bool:
        """Whether its values are numbers, and few."""
        return self.dtype.ndim == 0 or (self.description is not None and self.description[2] != 0)

    def values(self, records: NDArray[np.void], number: int) -> NDArray[Any]:
        """Return the values of all records."""
        stored = records[self.name] if self.dtype.ndim == 0 else records[self.name][:, number]
        _, scale, offset = self.meaning
        values = np.ascontiguousarray(stored)
        if scale is not None or offset is not None:
            values = stored * (scale[number] if scale else 1.0) + (offset[number] if offset else 0.0)
        if (no_data := self.no_data) is not None:
            values = np.where(_is_no_data(stored, no_data[number]), np.nan, values.astype(np.float64))
        return values

    def _declared(self, kind: str, option: int, at: int) -> tuple[Any, ...] | None:
        # In what is no number, the options are the number of bytes.
        if self.description is None or self.description[2] == 0 or not self.description[3] & option:
            return None
        count = self.dtype.shape[0] if self.dtype.ndim else 1
        return tuple(np.frombuffer(self.description, f"<{kind}", count, at).tolist())


class Dimensions:
    """The dimensions of one file.

    names : all that can be asked for
    extra : the extra dimensions, in the order in which they are stored
    """

    def __init__(self, point_format: Any, vlrs: Iterable[Record]) -> None:
        described = next((descriptions(record) for record in vlrs if record.key == EXTRA_BYTES), [])
        extra = list(point_format.extra_dimensions)
        # laspy leaves descriptions of dimensions out that the points have no room for.
        described = described if len(extra) >= len(described) else []
        padded = [*described, *[None] * (len(extra) - len(described))]
        self.extra = tuple(
            ExtraDimension(one.name, np.dtype(one.type_str()), description)
            for one, description in zip(extra, padded, strict=True)
        )
        self._has_steps = point_format.id >= _FIRST_FORMAT_WITH_STEPS
        self._extra = dict(self._numbered())
        standard = [one.name for one in point_format.standard_dimensions]
        letters = {letters_of(name) for name in (*standard, *self._extra)}
        other = [name for name in _SCAN_ANGLE_NAMES if letters_of(name) not in letters]
        self.names = (*standard, *other, *self._extra)

    def values(self, records: Any, name: str) -> NDArray[Any]:
        """Return the values of an attribute, of points that laspy has read."""
        if name in self._extra:
            dimension, number = self._extra[name]
            return dimension.values(records.array, number)
        if name in _SCAN_ANGLE_NAMES:
            if self._has_steps:
                return np.asarray(records.array["scan_angle"] * 6.0 / _STEPS_PER_6_DEGREES)
            return np.ascontiguousarray(records.array["scan_angle_rank"])
        return np.ascontiguousarray(records[name])

    def _numbered(self) -> Iterable[tuple[str, tuple[ExtraDimension, int]]]:
        """Name each number of each dimension, as PDAL does: of several they are name0, name1, name2."""
        taken = {one.name for one in self.extra}
        for one in self.extra:
            if one.dtype.ndim == 0:
                yield one.name, (one, 0)
            elif one.is_numeric:
                for number in range(one.dtype.shape[0]):
                    if (name := f"{one.name}{number}") not in taken:
                        yield name, (one, number)


def _widest(dtype: np.dtype[Any]) -> str:
    return f"{dtype.kind}8"


def _is_no_data(stored: NDArray[Any], value: Any) -> NDArray[np.bool_]:
    if stored.dtype.kind == "f":
        return np.asarray(stored == stored.dtype.type(value))
    limits = np.iinfo(stored.dtype)
    if not limits.min <= value <= limits.max:
        return np.zeros(len(stored), np.bool_)
    return np.asarray(stored == stored.dtype.type(value))
