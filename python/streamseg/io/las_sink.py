"""Labelled clouds written as LAS or LAZ."""

from __future__ import annotations

from math import floor
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np

from ..errors import InvalidInput, warn
from .cloud import DEFAULT_CHUNK, Chunk, Cloud
from .las_layout import COPC_USER, WAVEFORM_FORMATS, id_dimension, labelled_layout, new_layout
from .las_records import WAVEFORMS, Record
from .las_writer import LasWriter
from .lattice import Lattice, Triple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from .las import LasSource

    IdType = Callable[[int | None], np.dtype[Any]]

_INT32 = np.iinfo(np.int32)
_STEPS_OF_SMALL_CLOUDS = 1e6
_MOST_OLD_POINTS = 2**32 - 1
_FIRST_MINOR_FOR_MORE = 4
_LAX_USER = "LAStools"
_FORMATS_WITH_CHANNELS_AND_WAVEFORMS, _CHANNEL_BITS = (9, 10), 0b11_0000


class RecordSink:
    """LAS and LAZ in, LAS or LAZ out: every dimension and record is kept.

    `id_type` says of which type the ids of so many points are.
    """

    def __init__(self, cloud: Cloud, compressed: bool, id_name: str, id_type: IdType) -> None:
        self._cloud = cloud
        self._sources = cast("tuple[LasSource, ...]", cloud.sources)
        self._compressed = compressed
        self._id_name = id_name
        self._layout = labelled_layout(self._sources, id_dimension(id_name, id_type(cloud.point_count)))
        minor = self._layout.minor_version
        if minor < _FIRST_MINOR_FOR_MORE and (cloud.point_count or 0) > _MOST_OLD_POINTS:
            raise InvalidInput(f"LAS 1.{minor} holds at most {_MOST_OLD_POINTS:,} points, got {cloud.point_count:,}")
        self._read = 0
        if compressed:
            for source in self._sources:
                _require_one_channel(source)

    def begin(self, file: BinaryIO) -> None:
        """Write the header."""
        self._writer = LasWriter(file, self._layout, self._cloud.lattice, self._compressed)

    def blocks(self) -> Iterator[tuple[int, Any]]:
        """Yield the number of points and the records, per block."""
        self._cloud.damage = None
        for index, source in enumerate(self._sources):
            with self._cloud.witnesses[index].reading() as reading:
                for records in source.records(DEFAULT_CHUNK):
                    self._read += len(records)
                    reading.add(_steps(records))
                    yield len(records), (index, records.array)
                    del records  # before the next are read
                reading.is_damaged = source.damage is not None
            self._cloud.note_damage(source)

    def append(self, block: tuple[int, NDArray[np.void]], ids: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
        """Write those records of the block that are `kept`."""
        index, records = block
        if not kept.all():
            records, ids = records[kept], ids[kept]
        points = np.zeros(len(records), self._writer.dtype)
        # Bit fields are copied packed and scaled dimensions unscaled, so nothing is rounded.
        for name in set(records.dtype.names or ()) - {self._id_name}:
            points[name] = records[name]
        shift = self._cloud.shifts[index]
        if not shift.is_identity:
            steps = _steps(records)
            shift.apply(steps)
            _set_steps(points, steps, self._cloud.lattice, self._sources[index].path.name)
        _set_ids(points, self._id_name, ids)
        self._writer.write(points)
        return len(records)

    def finish(self) -> None:
        """Write what stands behind the points and the final header."""
        first = self._sources[0]
        is_same_points = len(self._sources) == 1 and self._read == first.header.point_count
        # A spatial index counts points, so it is only true of the same points.
        dropped = {COPC_USER} if is_same_points else {COPC_USER, _LAX_USER}
        whole = first.evlrs()
        if len(whole) < first.announced_evlrs:
            warn(
                f"{first.path.name} announces {first.announced_evlrs:,} extended records, {len(whole):,} of them lie "
                "inside the file; the others are left out"
            )
        kept = [record for record in whole if record.key[0] not in dropped]
        self._warn_of_waveforms(first, kept)
        self._writer.finish([*kept, *self._layout.last])

    def _warn_of_waveforms(self, source: LasSource, kept: list[Record]) -> None:
        """Warn of pointers to waveforms that do not come along."""
        encoding = source.header.global_encoding
        if source.header.point_format.id not in WAVEFORM_FORMATS:
            return
        if encoding.waveform_data_packets_external:
            name = source.path.with_suffix(".wdp").name
            warn(
                f"the waveforms of {source.path.name} are in {name}, which is not copied; give it the output's name too"
            )
        elif encoding.waveform_data_packets_internal and all(record.key != WAVEFORMS for record in kept):
            warn(f"{source.path.name} says that it holds waveforms, and has none that can be read; none are written")


class PointSink:
    """Points from other formats written as LAS 1.4, point format 6, with the segment id as only attribute."""

    def __init__(self, cloud: Cloud, compressed: bool, id_name: str, id_type: IdType) -> None:
        self._cloud = cloud
        self._compressed = compressed
        self._id_name = id_name
        self._lattice, count = _measured(cloud)
        self._layout = new_layout(id_dimension(id_name, id_type(count)))
        self._left_out = 0

    def begin(self, file: BinaryIO) -> None:
        """Write the header."""
        self._writer = LasWriter(file, self._layout, self._lattice, self._compressed)

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
        points = np.zeros(len(steps), self._writer.dtype)
        _set_steps(points, steps, lattice, self._cloud.paths[0].name)
        points["bit_fields"] = 0x11  # the first return of one
        _set_ids(points, self._id_name, ids[kept])
        self._writer.write(points)
        return len(steps)

    def finish(self) -> None:
        """Write the final header."""
        self._writer.finish([])
        if self._left_out:
            warn(f"{self._left_out:,} points have no finite coordinates, which LAS cannot hold; they are left out")


def _measured(cloud: Cloud) -> tuple[Lattice, int]:
    """Choose scale and offset for a cloud of plain coordinates, after a pass over it that counts its points.

    The offset is the largest whole number not above the smallest coordinate. The scale is 0.001; finer for clouds
    less than 10 units wide, so that the longest side has at least a million steps; coarser, with a warning, where
    0.001 does not fit into 32 bits.
    """
    low, high, count = np.full(3, np.inf), np.full(3, -np.inf), 0
    for chunk in cloud.chunks(DEFAULT_CHUNK):
        count += len(chunk.points)
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
    return Lattice((scale, scale, scale), offset), count


def _steps(records: Any) -> NDArray[np.float64]:
    """Give the whole numbers that the file has as coordinates, (n, 3)."""
    return np.column_stack([records[axis] for axis in "XYZ"]).astype(np.float64)


def _require_one_channel(source: LasSource) -> None:
    """Refuse to compress waveforms of several scanner channels, which the encoder (lazrs 0.8) mixes up.

    Raises
    ------
    InvalidInput
        Not all points are of one channel.
    """
    number = source.header.point_format.id
    if number not in _FORMATS_WITH_CHANNELS_AND_WAVEFORMS:
        return
    seen: set[int] = set()
    for records in source.records(DEFAULT_CHUNK):
        seen.update(np.unique(records.array["classification_flags"] & _CHANNEL_BITS).tolist())
        if len(seen) > 1:
            raise InvalidInput(
                f"{source.path.name} is of point format {number} and has several scanner channels, whose waveforms "
                "cannot be compressed without loss; write .las"
            )


def _set_steps(points: NDArray[np.void], steps: NDArray[np.float64], lattice: Lattice, name: str) -> None:
    if len(steps) and (steps.min() < _INT32.min or steps.max() > _INT32.max):
        raise InvalidInput(
            f"{name} has points too far away for 32 bit steps of scale {lattice.scale} from offset {lattice.offset}; "
            "write the files one by one, or bring them to one coarser scale first"
        )
    for axis, dimension in enumerate("XYZ"):
        points[dimension] = steps[:, axis]


def _set_ids(points: NDArray[np.void], name: str, ids: NDArray[np.int64]) -> None:
    limits = np.iinfo(points.dtype[name])
    if len(ids) and not limits.min <= ids.min() <= ids.max() <= limits.max:
        odd = int(ids.max() if ids.max() > limits.max else ids.min())
        raise InvalidInput(f"segment id {odd} does not fit into {points.dtype[name]}, which the file has for ids")
    points[name] = ids
