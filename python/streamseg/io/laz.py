"""LAZ compression behind two functions; the only importer of lazrs.

lazrs reads fastest with several threads, for which it needs the chunk table at the end of the file. A truncated
file has lost that table. The sequential decoder can do without, but only takes that way when the source says it
cannot seek; `_ForwardOnly` says so. Damage is cornered by decoding in smaller and smaller steps up to it.
"""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from ..errors import MissingExtra

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

try:
    import lazrs
except ImportError as error:  # pragma: no cover - depends on the installation
    raise MissingExtra("reading and writing LAZ needs lazrs; install it: pip install laspy[lazrs]") from error

ALL_FIELDS = int(lazrs.SELECTIVE_DECOMPRESS_ALL)

# A LAZ chunk has 50 000 points and is the unit of parallel work: smaller reads would run on one thread.
_PARALLEL_BLOCK = 500_000
_CORNERING_STEPS = (8192, 128, 1)

_LAYERED = 3
_ITEMS_AT = 32
_EXTRA_BYTES_ITEM = 14  # one layer per byte
_LAYERS_OF_ITEM = {10: 9, 11: 1, 12: 2, 13: 1}  # point, color, color and infrared, waveform

# Point formats from 6 on are compressed in layers; a layer that is not asked for need not be decoded.
_LAYERS = {
    "Z": lazrs.SELECTIVE_DECOMPRESS_Z,
    "classification": lazrs.SELECTIVE_DECOMPRESS_CLASSIFICATION,
    "synthetic": lazrs.SELECTIVE_DECOMPRESS_FLAGS,
    "key_point": lazrs.SELECTIVE_DECOMPRESS_FLAGS,
    "withheld": lazrs.SELECTIVE_DECOMPRESS_FLAGS,
    "overlap": lazrs.SELECTIVE_DECOMPRESS_FLAGS,
    "scan_direction_flag": lazrs.SELECTIVE_DECOMPRESS_FLAGS,
    "edge_of_flight_line": lazrs.SELECTIVE_DECOMPRESS_FLAGS,
    "intensity": lazrs.SELECTIVE_DECOMPRESS_INTENSITY,
    "scan_angle": lazrs.SELECTIVE_DECOMPRESS_SCAN_ANGLE,
    "user_data": lazrs.SELECTIVE_DECOMPRESS_USER_DATA,
    "point_source_id": lazrs.SELECTIVE_DECOMPRESS_POINT_SOURCE_ID,
    "gps_time": lazrs.SELECTIVE_DECOMPRESS_GPS_TIME,
    "red": lazrs.SELECTIVE_DECOMPRESS_RGB,
    "green": lazrs.SELECTIVE_DECOMPRESS_RGB,
    "blue": lazrs.SELECTIVE_DECOMPRESS_RGB,
    "nir": lazrs.SELECTIVE_DECOMPRESS_NIR,
}
_BASE_LAYER = {"X", "Y", "return_number", "number_of_returns", "scanner_channel"}


class LazPoints(NamedTuple):
    """What it takes to decode the points of one file."""

    start: int
    record_data: bytes
    point_count: int
    record_length: int


class _DecodingError(Exception):
    """The decoder gave up."""


class _ForwardOnly:
    """A file that can be read but refuses to seek, which makes lazrs decode without the chunk table."""

    def __init__(self, file: BinaryIO) -> None:
        self._file: Any = file

    def read(self, size: int) -> bytes:
        data: bytes = self._file.read(size)
        return data

    def readinto(self, buffer: memoryview) -> int:
        count: int = self._file.readinto(buffer)
        return count

    def seek(self, *_: int) -> int:
        raise OSError("this stream only goes forward")


def decoded_blocks(
    file: BinaryIO, points: LazPoints, size: int, fields: int = ALL_FIELDS
) -> Generator[bytes | bytearray, None, str | None]:
    """Yield the raw records of all points, in order, up to the end or to the damage.

    Parameters
    ----------
    size : int
        Points per block are at most the larger of this and 500 000, so that threads have work.
    fields : int
        What `layers` returned.

    Returns
    -------
    str or None
        Why decoding stopped before the announced number of points.
    """
    if (mismatch := _record_mismatch(points)) is not None:
        return mismatch
    block = max(size, _PARALLEL_BLOCK)
    table = _sound_chunk_table(file, points)
    has_table = table is not None
    sound = _count_sound_points(file, points, table)
    shortened = "the chunk after it is damaged" if sound < points.point_count else None
    points = points._replace(point_count=min(sound, points.point_count))
    done, reason = 0, ""
    try:
        decoder = _open(file, points, has_table, parallel=has_table, fields=fields)
        while done < points.point_count:
            decoded = _decode(decoder, points, min(block, points.point_count - done))
            yield decoded
            done += len(decoded) // points.record_length
        return shortened
    except _DecodingError as error:
        reason = str(error)
    stop = min(done + block, points.point_count)
    for step in _CORNERING_STEPS:
        try:
            decoder = _open_at(file, points, has_table, done)
            while done < stop:
                decoded = _decode(decoder, points, min(step, stop - done))
                yield decoded
                done += len(decoded) // points.record_length
        except _DecodingError as error:  # noqa: PERF203 - three rounds
            reason = str(error)
    return reason


def layers(names: Iterable[str]) -> int:
    """Which layers hold the dimensions `names`; all of them when a name is not a standard one."""
    selected = int(lazrs.SELECTIVE_DECOMPRESS_XY_RETURNS_CHANNEL)
    for name in names:
        if name not in _BASE_LAYER:
            selected |= int(_LAYERS.get(name, ALL_FIELDS))
    return selected


def encoder(file: BinaryIO, point_format: int, extra_bytes: int) -> tuple[bytes, Any]:
    """Return the laszip record's data, and a function that starts the encoder at the file's position.

    The encoder has ``compress_many(records)`` and ``done()``.
    """
    vlr = lazrs.LazVlr.new_for_compression(point_format, extra_bytes)
    return bytes(vlr.record_data()), lambda: lazrs.ParLasZipCompressor(file, vlr)


def _open(file: BinaryIO, points: LazPoints, has_table: bool, *, parallel: bool, fields: int = ALL_FIELDS) -> Any:
    file.seek(points.start)
    source = file if has_table else _ForwardOnly(file)
    # Fields that are not decoded are skipped by seeking, which a forward-only source refuses.
    selection = lazrs.DecompressionSelection(fields if has_table else ALL_FIELDS)
    kind = lazrs.ParLasZipDecompressor if parallel else lazrs.LasZipDecompressor
    return _guarded(lambda: kind(source, points.record_data, selection))


def _open_at(file: BinaryIO, points: LazPoints, has_table: bool, index: int) -> Any:
    decoder = _open(file, points, has_table, parallel=False)
    if has_table and index > 0:
        _guarded(lambda: decoder.seek(index))
        return decoder
    passed = 0
    while passed < index:  # without the table the only way to a point is through all before it
        count = min(_PARALLEL_BLOCK, index - passed)
        _decode(decoder, points, count)
        passed += count
    return decoder


def _decode(decoder: Any, points: LazPoints, count: int) -> bytearray:
    records = bytearray(count * points.record_length)
    _guarded(lambda: decoder.decompress_many(records))
    return records


def _guarded(call: Any) -> Any:
    try:
        return call()
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a Rust panic derives from BaseException only
        raise _DecodingError(_in_words(str(error))) from None


def _record_mismatch(points: LazPoints) -> str | None:
    try:
        length = int(_guarded(lambda: lazrs.LazVlr(points.record_data).item_size()))
    except _DecodingError as error:
        return str(error)
    if length == points.record_length:
        return None
    return f"the laszip record describes points of {length} bytes, the header of {points.record_length}"


def _in_words(message: str) -> str:
    return "unexpected end of data" if "fill whole buffer" in message else f"the decoder says: {message}"


def _sound_chunk_table(file: BinaryIO, points: LazPoints) -> list[tuple[int, int]] | None:
    """Check the table before lazrs believes it: sizes read from garbage would be allocated."""
    length = os.fstat(file.fileno()).st_size
    data_start = points.start + 8
    try:
        vlr = lazrs.LazVlr(points.record_data)
        file.seek(points.start)
        (table_start,) = struct.unpack("<q", file.read(8))
        if table_start <= points.start:  # written to a pipe: the position follows the table
            file.seek(length - 8)
            (table_start,) = struct.unpack("<q", file.read(8))
        if not data_start <= table_start <= length - 8:
            return None
        file.seek(table_start)
        _, chunks = struct.unpack("<II", file.read(8))
        if vlr.uses_variable_size_chunks():
            if chunks > points.point_count:
                return None
        elif chunks != -(-points.point_count // vlr.chunk_size()):
            return None
        file.seek(points.start)
        table: list[tuple[int, int]] = lazrs.read_chunk_table(file, vlr)
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException:  # whatever is wrong with it, there is a way without
        return None
    return table if sum(size for _, size in table) == table_start - data_start else None


def _count_sound_points(file: BinaryIO, points: LazPoints, table: list[tuple[int, int]] | None) -> int:
    """Count the points in front of the first chunk whose layers do not fit into the file.

    lazrs allocates as many bytes as a layer claims to have; damaged sizes would fill the memory. Chunks of the
    older, unlayered kind claim nothing.
    """
    layer_count = _layers_per_chunk(points.record_data)
    if layer_count == 0:
        return points.point_count
    layout = struct.Struct(f"<{1 + layer_count}I")
    length = os.fstat(file.fileno()).st_size
    at, counted, chunk = points.start + 8, 0, 0
    while counted < points.point_count:
        file.seek(at + points.record_length)  # a chunk starts with its first point, uncompressed
        head = file.read(layout.size)
        if len(head) < layout.size:
            break
        count, *sizes = layout.unpack(head)
        size = points.record_length + layout.size + sum(sizes)
        if count == 0 or at + size > length or (table is not None and size != table[chunk][1]):
            break
        at, counted, chunk = at + size, counted + count, chunk + 1
        if table is not None and chunk == len(table):
            break
    return counted


def _layers_per_chunk(record_data: bytes) -> int:
    """Read from the laszip record how many compressed layers a chunk has; 0 for the unlayered kind."""
    (compressor,) = struct.unpack_from("<H", record_data)
    if compressor != _LAYERED:
        return 0
    (count,) = struct.unpack_from("<H", record_data, _ITEMS_AT)
    items = [struct.unpack_from("<HH", record_data, _ITEMS_AT + 2 + 6 * index) for index in range(count)]
    return sum(size if kind == _EXTRA_BYTES_ITEM else _LAYERS_OF_ITEM.get(kind, 0) for kind, size in items)
