"""Labelled clouds written as LAS or LAZ, by laspy."""

from __future__ import annotations

from copy import deepcopy
from math import floor
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np

from ..errors import InvalidInput, warn
from .cloud import DEFAULT_CHUNK, Chunk, Cloud
from .labels import SEGMENT_DIMENSION
from .las import LasSource, laspy
from .lattice import Lattice, Triple

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

_INT32 = np.iinfo(np.int32)
_STEPS_OF_SMALL_CLOUDS = 1e6
_LONGEST_RECORD = 65535
_WAVEFORM_FORMATS = {4, 5, 9, 10}
# Formats that share their bit fields and differ only in which of time, color and infrared they carry.
_FAMILIES = ((0, 1, 2, 3), (6, 7, 8))
_EXTRA_BYTES, _WAVEFORMS = ("LASF_Spec", 4), ("LASF_Spec", 65535)
_LASZIP_USER, _COPC_USER, _LAX_USER = "laszip encoded", "copc", "LAStools"
_EVLR_HEAD = 60


class RecordSink:
    """LAS and LAZ in, LAS or LAZ out: every dimension and record is kept."""

    def __init__(self, cloud: Cloud, compressed: bool) -> None:
        self._cloud = cloud
        self._sources = cast("tuple[LasSource, ...]", cloud.sources)
        self._compressed = compressed
        self._header = _labelled_header(self._sources)
        self._header.scales, self._header.offsets = np.array(cloud.lattice.scale), np.array(cloud.lattice.offset)
        if (cloud.point_count or 0) > self._header.max_point_count():
            limit = self._header.max_point_count()
            raise InvalidInput(f"LAS {self._header.version} holds at most {limit:,} points, got {cloud.point_count:,}")
        self._read = 0

    def begin(self, file: BinaryIO) -> None:
        """Write the header."""
        self._file, self._writer = file, _writer(file, self._header, self._compressed)

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and the records, per block."""
        self._cloud.damage = None
        for index, source in enumerate(self._sources):
            for records in source.records(DEFAULT_CHUNK):
                self._read += len(records)
                yield len(records), (index, records.array)
                del records  # before the next are read
            self._cloud.note_damage(source)

    def append(self, block: tuple[int, NDArray[np.void]], ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those records of the block that are `kept`."""
        index, records = block
        if not kept.all():
            records, ids = records[kept], ids[kept]
        points = laspy.PackedPointRecord.zeros(len(records), self._writer.header.point_format)
        # Bit fields are copied packed and scaled dimensions unscaled, so nothing is rounded.
        for name in set(records.dtype.names or ()) - {SEGMENT_DIMENSION}:
            points.array[name] = records[name]
        shift = self._cloud.shifts[index]
        if not shift.is_identity:
            steps = np.column_stack([records[axis] for axis in "XYZ"]).astype(np.float64)
            shift.apply(steps)
            _set_steps(points, steps, self._cloud.lattice, self._sources[index].path.name)
        points.array[SEGMENT_DIMENSION] = ids
        self._writer.write_points(points)
        return len(records)

    def finish(self) -> None:
        """Write what stands behind the points and the final header."""
        header = self._writer.header
        is_same_points = len(self._sources) == 1 and self._read == header.point_count
        header.start_of_waveform_data_packet_record = 0
        # A spatial index counts points, so it is only true of the same points.
        dropped = {_COPC_USER} if is_same_points else {_COPC_USER, _LAX_USER}
        if evlrs := [evlr for evlr in self._sources[0].evlrs() if evlr.user_id not in dropped]:
            self._writer.point_writer.done()
            self._writer.done = True
            at = self._file.seek(0, 2)
            if header.version.minor >= 4:
                header.start_of_first_evlr, header.number_of_evlrs = at, len(evlrs)
            for evlr in evlrs:
                if (evlr.user_id, evlr.record_id) == _WAVEFORMS:
                    header.start_of_waveform_data_packet_record = at
                at += _EVLR_HEAD + len(evlr.record_data)
            laspy.vlrs.vlrlist.VLRList(evlrs).write_to(self._file, as_extended=True)
        self._writer.close()


class PointSink:
    """Points from other formats written as LAS 1.4, point format 6, with the segment id as only attribute."""

    def __init__(self, cloud: Cloud, compressed: bool) -> None:
        self._cloud = cloud
        self._compressed = compressed
        self._lattice = fitting_lattice(cloud)
        self._left_out = 0
        self._header = laspy.LasHeader(version="1.4", point_format=6)
        self._header.global_encoding.wkt = True  # required from point format 6 on
        self._header.generating_software = "streamseg"
        self._header.scales, self._header.offsets = np.array(self._lattice.scale), np.array(self._lattice.offset)
        _describe(self._header, [_segment_dimension()], {})

    def begin(self, file: BinaryIO) -> None:
        """Write the header."""
        self._writer = _writer(file, self._header, self._compressed)

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and the points, per block."""
        for chunk in self._cloud.chunks(DEFAULT_CHUNK):
            yield len(chunk.points), chunk

    def append(self, block: Chunk, ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those points of the block that are `kept` and that LAS can hold."""
        valid = np.isfinite(block.points).all(axis=1)
        self._left_out += int(np.count_nonzero(kept & ~valid))
        kept = kept & valid
        coordinates, lattice = block.points[kept], self._lattice
        steps = np.rint((coordinates - np.asarray(lattice.offset)) / np.asarray(lattice.scale))
        points = laspy.PackedPointRecord.zeros(len(steps), self._writer.header.point_format)
        _set_steps(points, steps, lattice, self._cloud.paths[0].name)
        points["return_number"] = points["number_of_returns"] = np.ones(len(steps), np.uint8)
        points[SEGMENT_DIMENSION] = ids[kept]
        self._writer.write_points(points)
        return len(steps)

    def finish(self) -> None:
        """Write the final header."""
        self._writer.close()
        if self._left_out:
            warn(f"{self._left_out:,} points have no finite coordinates, which LAS cannot hold; they are left out")


def fitting_lattice(cloud: Cloud) -> Lattice:
    """Choose scale and offset for a cloud of plain coordinates, after a pass over it.

    The offset is the largest whole number not above the smallest coordinate. The scale is 0.001; finer for clouds
    less than 10 units wide, so that the longest side has at least a million steps; coarser, with a warning, where
    0.001 does not fit into 32 bits.
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for chunk in cloud.chunks(DEFAULT_CHUNK):
        points = chunk.points[np.isfinite(chunk.points).all(axis=1)]
        if len(points):
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    if not np.isfinite(low).all():
        raise InvalidInput(f"{cloud.paths[0]} has no point with finite coordinates, and LAS holds no other")
    offset = cast("Triple", tuple(float(floor(value)) for value in low))
    reach = float((high - np.asarray(offset)).max())
    extent = float((high - low).max())
    exponent = -3
    while exponent > -9 and 0 < extent < 10 and extent < _STEPS_OF_SMALL_CLOUDS * 10.0**exponent:
        exponent -= 1
    while reach > _INT32.max * 10.0**exponent:
        exponent += 1
    if exponent > -3:
        warn(
            f"{cloud.paths[0].name} is {extent:,.0f} units wide: LAS can hold it in steps of {10.0**exponent:g}, "
            "not in the usual 0.001; coordinates are rounded to these steps"
        )
    scale = float(f"1e{exponent}")
    return Lattice((scale, scale, scale), offset)


def _writer(file: BinaryIO, header: Any, compressed: bool) -> Any:
    return laspy.LasWriter(file, header, do_compress=compressed, closefd=False, encoding_errors="ignore")


def _set_steps(points: Any, steps: NDArray[np.float64], lattice: Lattice, name: str) -> None:
    if len(steps) and (steps.min() < _INT32.min or steps.max() > _INT32.max):
        raise InvalidInput(
            f"{name} has points too far away for 32 bit steps of scale {lattice.scale} from offset {lattice.offset}; "
            "write the files one by one, or bring them to one coarser scale first"
        )
    for axis, dimension in enumerate("XYZ"):
        points[dimension] = steps[:, axis]


def _labelled_header(sources: Sequence[LasSource]) -> Any:
    """Make the header of records that hold every dimension of all `sources`, and the segment id.

    Raises
    ------
    InvalidInput
        The point formats cannot be brought together.
    """
    header, point_format = deepcopy(sources[0].header), laspy.PointFormat(_common_format(sources))
    version = header.version
    if point_format.id not in laspy.point.dims.VERSION_TO_POINT_FMT.get(str(version), ()):
        version = type(version).from_str(laspy.point.dims.preferred_file_version_for_point_format(point_format.id))
    header.set_version_and_point_format(version, point_format)
    header.vlrs = [
        vlr
        for vlr in sources[0].vlrs  # the output is described and compressed anew, and not as an octree
        if vlr.user_id not in (_LASZIP_USER, _COPC_USER) and (vlr.user_id, vlr.record_id) != _EXTRA_BYTES
    ]
    known = {struct.name: struct for source in reversed(sources) for struct in _described(source.header)}
    known.pop(SEGMENT_DIMENSION.encode(), None)
    _describe(header, _union(sources), known)
    if header.point_format.size > _LONGEST_RECORD:
        size = header.point_format.size
        raise InvalidInput(f"points would take {size} bytes each with a segment id; LAS allows {_LONGEST_RECORD}")
    return header


def _segment_dimension() -> Any:
    params = laspy.ExtraBytesParams(SEGMENT_DIMENSION, "i8", "streamseg segment, -1 = none")
    return laspy.DimensionInfo.from_extra_bytes_param(params)


def _described(header: Any) -> list[Any]:
    return [struct for vlr in header.vlrs.get("ExtraBytesVlr") for struct in vlr.extra_bytes_structs]


def _describe(header: Any, dimensions: list[Any], known: dict[bytes, Any]) -> None:
    """Add extra dimensions, with their descriptions as they are `known`: laspy would lose what means no data.

    Smallest and largest values are not given: those that laspy finds are not true of all points.
    """
    names = {SEGMENT_DIMENSION, *(name.decode() for name in known)}
    described = [dimension for dimension in dimensions if dimension.name in names]
    # Bytes that nobody describes have to be the last.
    header.point_format.dimensions += described + [one for one in dimensions if one.name not in names]
    header.vlrs = list(header.vlrs)  # adds the record that describes the dimensions
    (record,) = header.vlrs.get("ExtraBytesVlr")
    structs = record.extra_bytes_structs[: len(described)]
    record.extra_bytes_structs = [deepcopy(known.get(struct.name, struct)) for struct in structs]
    for struct in record.extra_bytes_structs:
        if struct.data_type:
            struct.options &= ~(struct.MIN_BIT_MASK | struct.MAX_BIT_MASK)


def _common_format(sources: Sequence[LasSource]) -> int:
    formats = sorted({int(source.header.point_format.id) for source in sources})
    if len(formats) == 1 and (len(sources) == 1 or formats[0] not in _WAVEFORM_FORMATS):
        return formats[0]
    for family in _FAMILIES:
        if set(formats) <= set(family):
            # Format 3 is the only one that has both the time of 1 and the color of 2.
            return 3 if family[0] == 0 and formats[-2:] == [1, 2] else formats[-1]
    listed = ", ".join(f"{source.path.name} has {source.header.point_format.id}" for source in sources)
    raise InvalidInput(
        f"these files cannot be written as one: of their point formats ({listed}) only 0 to 3, or 6 to 8, go together"
    )


def _union(sources: Sequence[LasSource]) -> list[Any]:
    """List the extra dimensions of all files, and the segment id if it is not there or of another type."""
    union: dict[str, Any] = {}
    for source in sources:
        for dimension in source.header.point_format.extra_dimensions:
            if dimension.name == SEGMENT_DIMENSION:
                if dimension.dtype == np.int64 and not dimension.is_scaled:
                    union.setdefault(SEGMENT_DIMENSION, _segment_dimension())
                continue
            first = union.setdefault(dimension.name, dimension)
            is_scaled_alike = first._replace(description="") == dimension._replace(description="")
            if first.dtype != dimension.dtype or not is_scaled_alike:
                raise InvalidInput(
                    f"these files cannot be written as one: dimension {dimension.name!r} of {source.path.name} has "
                    f"another type, scale or offset than in {sources[0].path.name}"
                )
    union.setdefault(SEGMENT_DIMENSION, _segment_dimension())
    return list(union.values())
