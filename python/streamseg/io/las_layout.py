"""What stands before the points of an output: its header, its records, and what a point is made of."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InvalidInput
from .coordinate_system import PROJECTION_USER
from .labels import LAS_SIGN, SEGMENT_DIMENSION
from .las import LasSource, laspy
from .las_dimensions import ExtraDimension
from .las_records import EXTRA_BYTES, LONGEST_VLR, Record, new_record
from .las_writer import ENCODING_AT, MINOR_AT, WKT_BIT, adapted_header
from .spelling import letters_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

COPC_USER = "copc"
WAVEFORM_FORMATS = {4, 5, 9, 10}
_LASZIP_USER = "laszip encoded"
_LONGEST_POINT = 65535
# Formats that share their bit fields and differ only in which of time, color and infrared they carry.
_FAMILIES = ((0, 1, 2, 3), (6, 7, 8))

_EXTRA_DIMENSION = struct.Struct("<2xBB32s124x32s")
_TYPE_CODES = {"<i4": 6, "<i8": 8}
_SMALLEST_AND_LARGEST = 0b0110
_ABOUT_IDS = LAS_SIGN + b", -1 = none"


class Layout(NamedTuple):
    """All of a file but its points.

    padding : what stands between the records and the points
    last : records that are too long to stand before the points
    """

    header: bytes
    records: list[Record]
    padding: bytes
    point_format: Any
    last: Sequence[Record] = ()

    @property
    def minor_version(self) -> int:
        """The version of the file: 1 and this."""
        return self.header[MINOR_AT]


def labelled_layout(sources: Sequence[LasSource], ids: ExtraDimension) -> Layout:
    """Lay out a file whose records hold every dimension of all `sources`, and the segment id.

    Raises
    ------
    InvalidInput
        The point formats cannot be brought together.
    """
    first = sources[0]
    point_format = laspy.PointFormat(_common_format(sources))
    minor = first.header.version.minor
    if point_format.id not in laspy.point.dims.VERSION_TO_POINT_FMT.get(f"1.{minor}", ()):
        version = laspy.point.dims.preferred_file_version_for_point_format(point_format.id)
        minor = int(version.split(".")[1])
    union = _union(sources, ids)
    taken = {*point_format.dimension_names, *(point_format.dtype().names or ())}
    if twice := [one.name for one in union if one.name in taken]:
        raise InvalidInput(
            f"these files cannot be written as one: {twice[0]!r} is an extra dimension of one and a standard one of "
            "another"
        )
    _add(point_format, union)
    if point_format.size > _LONGEST_POINT:
        size = point_format.size
        raise InvalidInput(f"points would take {size} bytes each with a segment id; LAS allows {_LONGEST_POINT}")
    records = _records(sources, union)
    if any(len(record.data) > LONGEST_VLR for record in records):
        raise InvalidInput(f"there are {len(union):,} extra dimensions with the segment id; LAS can describe 341")
    header, last = first.raw_header, list[Record]()
    says_wkt = bool(header[ENCODING_AT] & WKT_BIT)
    if donor := donor_of_system(sources):
        says_wkt = bool(donor.raw_header[ENCODING_AT] & WKT_BIT)
        for record in (*donor.vlrs, *donor.evlrs()):
            if record.key[0] == PROJECTION_USER:
                (records if len(record.data) <= LONGEST_VLR else last).append(record)
    padding = first.header.extra_vlr_bytes
    return Layout(adapted_header(header, minor, says_wkt), records, padding, point_format, last)


def donor_of_system(sources: Sequence[LasSource]) -> LasSource | None:
    """Find the file whose coordinate system the output gets, because the first says of none."""
    said = next((source for source in sources if source.stated_system), sources[0])
    return None if said is sources[0] else said


def _records(sources: Sequence[LasSource], dimensions: Sequence[ExtraDimension]) -> list[Record]:
    """List the records of the first file; the points are described anew, and compressed anew, not as an octree."""
    first, dropped = sources[0], {_LASZIP_USER, COPC_USER}
    if donor_of_system(sources) is not None:
        dropped.add(PROJECTION_USER)
    before = [record for record in first.vlrs if record.key == EXTRA_BYTES]
    described = _described(before, dimensions, keep_limits=len(sources) == 1)
    records = [record for record in first.vlrs if record.key[0] not in dropped]
    place = records.index(before[0]) if before else len(records)
    kept = [record for record in records if record.key != EXTRA_BYTES]
    return [*kept[:place], described, *kept[place:]]


def new_layout(ids: ExtraDimension) -> Layout:
    """Lay out a file of version 1.4 and point format 6 with nothing but segment ids."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.global_encoding.wkt = True  # required from point format 6 on
    header.generating_software = "streamseg"
    raw = io.BytesIO()
    header.write_to(raw)
    _add(header.point_format, [ids])
    return Layout(raw.getvalue(), [_described([], [ids], keep_limits=False)], b"", header.point_format)


def id_dimension(name: str, dtype: np.dtype[Any]) -> ExtraDimension:
    """Make the dimension of segment ids."""
    packed = _EXTRA_DIMENSION.pack(_TYPE_CODES[dtype.str], 0, name.encode(), _ABOUT_IDS)
    return ExtraDimension(name, dtype, packed)


def _add(point_format: Any, dimensions: Sequence[ExtraDimension]) -> None:
    point_format.dimensions += [
        laspy.DimensionInfo.from_dtype(one.name, one.dtype, is_standard=False) for one in dimensions
    ]


def _described(before: list[Record], dimensions: Sequence[ExtraDimension], keep_limits: bool) -> Record:
    """Describe the extra dimensions as they are described, but for the limits that may not be true of all files."""
    data = bytearray()
    for one in dimensions:
        if one.description is None:
            continue
        description = bytearray(one.description)
        if not keep_limits and description[2]:
            description[3] &= ~_SMALLEST_AND_LARGEST
        data += description
    if before:
        return before[0]._replace(data=bytes(data))
    return new_record(EXTRA_BYTES, "Extra Bytes Record", bytes(data))


def _common_format(sources: Sequence[LasSource]) -> int:
    formats = sorted({int(source.header.point_format.id) for source in sources})
    if len(formats) == 1 and (len(sources) == 1 or formats[0] not in WAVEFORM_FORMATS):
        return formats[0]
    for family in _FAMILIES:
        if set(formats) <= set(family):
            # Format 3 is the only one that has both the time of 1 and the color of 2.
            return 3 if family[0] == 0 and formats[-2:] == [1, 2] else formats[-1]
    listed = ", ".join(f"{source.path.name} has {source.header.point_format.id}" for source in sources)
    raise InvalidInput(
        f"these files cannot be written as one: of their point formats ({listed}) only 0 to 3, or 6 to 8, go together"
    )


def _union(sources: Sequence[LasSource], ids: ExtraDimension) -> list[ExtraDimension]:
    """List the extra dimensions of all files, and the segment id, in its place if it is there and of the same type."""
    union: dict[str, ExtraDimension] = {}
    for source in sources:
        for dimension in source.extra_dimensions:
            if dimension.name == ids.name:
                if ids.name != SEGMENT_DIMENSION and not dimension.holds_ids_of_ours:
                    raise InvalidInput(
                        f"{source.path.name} has a dimension {ids.name!r} that streamseg has not written; "
                        "give the ids another name with id_name (--id-name)"
                    )
                if dimension.dtype == ids.dtype and dimension.meaning == ids.meaning:
                    union.setdefault(ids.name, ids)
                continue
            if letters_of(dimension.name) == letters_of(ids.name):
                raise InvalidInput(
                    f"{source.path.name} has a dimension {dimension.name!r}, which nobody can tell from {ids.name!r}; "
                    "give the ids another name with id_name (--id-name)"
                )
            first = union.setdefault(dimension.name, dimension)
            if first.meaning != dimension.meaning or first.no_data != dimension.no_data:
                raise InvalidInput(
                    f"these files cannot be written as one: dimension {dimension.name!r} of {source.path.name} has "
                    f"another type, scale or offset than in {sources[0].path.name}, or another value for no data"
                )
    union.setdefault(ids.name, ids)
    # Bytes that nobody describes have to be the last.
    return sorted(union.values(), key=lambda one: one.description is None)
