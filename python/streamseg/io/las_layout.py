"""Which bytes of an input record go where in an output record that has a segment id too.

Standard fields and extra bytes are moved as runs of bytes, never interpreted, so nothing is lost or rounded.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import InvalidInput
from .labels import SEGMENT_DIMENSION
from .las import LasSource, stored_fields
from .las_header import COPC_USER, EXTRA_BYTES_RECORD, EXTRA_BYTES_USER, LASZIP_USER, LasHeader, Vlr, new_vlr

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_INT64 = 8
_SCALE_OR_OFFSET_BITS = 0b11000
_DESCRIPTOR_SIZE = 192
_DESCRIBED_SIZES = (1, 1, 2, 2, 4, 4, 8, 8, 4, 8)
_LONGEST_UNTYPED = 255
_LONGEST_RECORD = 65535
_WAVEFORM_FORMATS = {4, 5, 9, 10}
# Formats that share their bit fields and differ only in which of time, color and infrared they carry.
_FAMILIES = ((0, 1, 2, 3), (6, 7, 8))


@dataclass(frozen=True)
class ExtraField:
    """One dimension in the extra bytes: its size, and the 192 bytes that describe it."""

    name: bytes
    size: int
    descriptor: bytes

    def is_compatible(self, other: ExtraField) -> bool:
        """Whether the bytes mean the same: type, scale and offset."""
        mine, theirs = self.descriptor, other.descriptor
        kept = slice(112, 160)
        return (
            mine[2] == theirs[2]
            and self.size == other.size
            and (mine[3] & _SCALE_OR_OFFSET_BITS == theirs[3] & _SCALE_OR_OFFSET_BITS and mine[kept] == theirs[kept])
        )


class Run(NamedTuple):
    """Bytes to copy: `length` of them, from `source` in the input record to `target` in the output record."""

    target: int
    source: int
    length: int


class RecordLayout(NamedTuple):
    """How output records are made.

    header : the output's header, its laszip record still missing
    runs : per input file
    segment_at : byte position of the segment id, int64
    """

    header: LasHeader
    runs: list[list[Run]]
    segment_at: int

    def convert(self, records: NDArray[np.void], file: int) -> NDArray[np.uint8]:
        """Copy ``(n,)`` records of input `file` into ``(n, record_length)`` bytes."""
        length = self.header.record_length
        target = np.zeros((len(records), length), np.uint8)
        source = records.view(np.uint8).reshape(len(records), records.dtype.itemsize)
        for run in self.runs[file]:
            target[:, run.target : run.target + run.length] = source[:, run.source : run.source + run.length]
        return target


def labelled_layout(sources: Sequence[LasSource]) -> RecordLayout:
    """Lay out records that hold every dimension of all `sources`, and the segment id.

    Raises
    ------
    InvalidInput
        The point formats cannot be brought together.
    """
    point_format = _common_format(sources)
    per_file = [extra_fields(source.header, source.record_type) for source in sources]
    extras = [_reset_segment(field) for field in _union(sources, per_file) if not _is_stale_segment(field)]
    if not any(field.name == SEGMENT_DIMENSION.encode() for field in extras):
        extras.append(segment_field())
    standard = stored_fields(point_format)
    target = _positions(standard, extras)
    length = standard.itemsize + sum(field.size for field in extras)
    if length > _LONGEST_RECORD:
        raise InvalidInput(f"points would take {length} bytes each with a segment id; LAS allows {_LONGEST_RECORD}")
    runs = []
    for source, fields in zip(sources, per_file, strict=True):
        own = _positions(stored_fields(source.header.point_format), fields)
        runs.append(_merge(Run(target[name][0], at, size) for name, (at, size) in own.items() if name in target))
    header = describe_extras(sources[0].header, extras)
    header = header.patched("BH", 104, point_format, length)
    if point_format in (2, 3) and header.minor < 2:
        header = header.patched("B", 25, 2)
    return RecordLayout(header, runs, target[SEGMENT_DIMENSION.encode()][0])


def describe_extras(header: LasHeader, extras: Sequence[ExtraField]) -> LasHeader:
    """Replace the record that describes the extra bytes, and drop those that will no longer be true."""
    data = b"".join(field.descriptor for field in extras)
    described = header.find(EXTRA_BYTES_USER, EXTRA_BYTES_RECORD)
    vlrs: list[Vlr] = []
    for vlr in header.vlrs:
        if vlr is described:
            vlrs.append(replace(vlr, data=data))
        elif vlr.user not in (LASZIP_USER, COPC_USER):  # the output is compressed anew, and not as an octree
            vlrs.append(vlr)
    if described is None:
        vlrs.append(new_vlr(EXTRA_BYTES_USER, EXTRA_BYTES_RECORD, data, b"Extra Bytes Record"))
    return replace(header, vlrs=tuple(vlrs))


def segment_field() -> ExtraField:
    """Describe the dimension that streamseg adds: int64, −1 = none."""
    descriptor = bytearray(_DESCRIPTOR_SIZE)
    descriptor[2] = _INT64
    name = SEGMENT_DIMENSION.encode()
    descriptor[4 : 4 + len(name)] = name
    description = b"streamseg segment, -1 = none"
    descriptor[160 : 160 + len(description)] = description
    return ExtraField(name, 8, bytes(descriptor))


def extra_fields(header: LasHeader, record_type: np.dtype[Any]) -> list[ExtraField]:
    """List the dimensions in a file's extra bytes, undescribed bytes included."""
    left = record_type.itemsize - stored_fields(header.point_format).itemsize
    fields: list[ExtraField] = []
    described = header.find(EXTRA_BYTES_USER, EXTRA_BYTES_RECORD)
    if described is not None and left > 0:
        for at in range(0, len(described.data) - _DESCRIPTOR_SIZE + 1, _DESCRIPTOR_SIZE):
            descriptor = described.data[at : at + _DESCRIPTOR_SIZE]
            fields.append(ExtraField(descriptor[4:36].split(b"\0")[0], _size(descriptor), descriptor))
            left -= fields[-1].size
    number = 1
    while left > 0:
        size = min(left, _LONGEST_UNTYPED)
        name = b"ExtraBytes" if number == 1 else f"ExtraBytes{number}".encode()
        descriptor = bytes(3) + bytes([size]) + name.ljust(_DESCRIPTOR_SIZE - 4, b"\0")
        fields.append(ExtraField(name, size, descriptor))
        left, number = left - size, number + 1
    return fields


def _size(descriptor: bytes) -> int:
    kind = descriptor[2]
    if kind == 0:
        return descriptor[3]
    times, base = divmod(kind - 1, len(_DESCRIBED_SIZES))
    return (times + 1) * _DESCRIBED_SIZES[base]


def _is_stale_segment(field: ExtraField) -> bool:
    """Whether this is a SegmentID of another type, which could not hold every id."""
    is_int64 = field.descriptor[2] == _INT64 and not field.descriptor[3] & _SCALE_OR_OFFSET_BITS
    return field.name == SEGMENT_DIMENSION.encode() and not is_int64


def _reset_segment(field: ExtraField) -> ExtraField:
    """Forget the smallest and largest id of an earlier run."""
    return segment_field() if field.name == SEGMENT_DIMENSION.encode() and not _is_stale_segment(field) else field


def _common_format(sources: Sequence[LasSource]) -> int:
    formats = sorted({source.header.point_format for source in sources})
    if len(formats) == 1 and (len(sources) == 1 or formats[0] not in _WAVEFORM_FORMATS):
        return formats[0]
    for family in _FAMILIES:
        if set(formats) <= set(family):
            # Format 3 is the only one that has both the time of 1 and the color of 2.
            return 3 if family[0] == 0 and formats[-2:] == [1, 2] else formats[-1]
    listed = ", ".join(f"{source.path.name} has {source.header.point_format}" for source in sources)
    raise InvalidInput(
        f"these files cannot be written as one: of their point formats ({listed}) only 0 to 3, or 6 to 8, go together"
    )


def _union(sources: Sequence[LasSource], per_file: list[list[ExtraField]]) -> list[ExtraField]:
    union: dict[bytes, ExtraField] = {}
    for source, fields in zip(sources, per_file, strict=True):
        for field in fields:
            known = union.setdefault(field.name, field)
            if field.name != SEGMENT_DIMENSION.encode() and not known.is_compatible(field):
                raise InvalidInput(
                    f"these files cannot be written as one: dimension {field.name.decode(errors='replace')!r} of "
                    f"{source.path.name} has another type, scale or offset than in {sources[0].path.name}"
                )
    return list(union.values())


def _positions(standard: np.dtype[Any], extras: Sequence[ExtraField]) -> dict[bytes, tuple[int, int]]:
    """Byte position and size of each field in a record."""
    names = standard.names or ()
    positions = {name.encode(): (int(standard.fields[name][1]), standard[name].itemsize) for name in names}  # type: ignore[index]
    at = standard.itemsize
    for field in extras:
        positions[field.name] = (at, field.size)
        at += field.size
    return positions


def _merge(runs: Any) -> list[Run]:
    merged: list[Run] = []
    for run in sorted(runs):
        last = merged[-1] if merged else None
        if last and last.target + last.length == run.target and last.source + last.length == run.source:
            merged[-1] = Run(last.target, last.source, last.length + run.length)
        else:
            merged.append(run)
    return merged
