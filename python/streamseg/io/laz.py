"""What laspy cannot do: read a damaged LAZ up to its last point that can be decoded.

lazrs believes the sizes it finds and allocates as many bytes, so they are held against the file first. It also
wants the chunk table at the end of the file, which a truncated file has lost. Its sequential decoder can do without,
but only takes that way when the source says that it cannot seek; `ForwardOnly` says so.
"""

from __future__ import annotations

import struct
from mmap import ACCESS_READ, mmap
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from ..errors import MissingExtra

if TYPE_CHECKING:
    from collections.abc import Callable

try:
    import lazrs
except ImportError as error:  # pragma: no cover - depends on the installation
    raise MissingExtra("reading and writing LAZ needs lazrs; install it: pip install laspy[lazrs]") from error

_LAYERED = 3
_ITEMS_AT = 32
_EXTRA_BYTES_ITEM = 14  # one layer per byte
_LAYERS_OF_ITEM = {10: 9, 11: 1, 12: 2, 13: 1}  # point, color, color and infrared, waveform


class Undecodable(Exception):
    """The decoder gave up."""


class Sound(NamedTuple):
    """What of a file can be decoded safely: so many points, and whether its chunk table is to be believed."""

    points: int
    has_table: bool


class ForwardOnly:
    """A file that can be read but refuses to seek."""

    def __init__(self, file: Any) -> None:
        self.read, self.readinto = file.read, file.readinto

    def seek(self, *_: int) -> int:
        """Refuse."""
        raise OSError("this stream only goes forward")


def guarded(call: Callable[..., Any], *arguments: Any) -> Any:
    """Call a decoder; whatever goes wrong in it becomes `Undecodable`."""
    try:
        return call(*arguments)
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # a Rust panic derives from BaseException only
        message = str(error)
        in_words = "unexpected end of data" if "fill whole buffer" in message else f"the decoder says: {message}"
        raise Undecodable(in_words) from None


def sound_part(file: BinaryIO, header: Any) -> Sound:
    """Find out how much of a LAZ can be given to lazrs.

    Raises
    ------
    Undecodable
        Nothing, because the laszip record is missing or of another file.
    """
    records = header.vlrs.get("LasZipVlr")
    if not records:
        raise Undecodable("the laszip record is missing")
    vlr = guarded(lazrs.LazVlr, records[0].record_data)
    if vlr.item_size() != header.point_format.size:
        raise Undecodable(
            f"the laszip record describes points of {vlr.item_size()} bytes, the header of {header.point_format.size}"
        )
    with mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        try:
            table = guarded(_chunk_table, file, data, header, vlr)
        except Undecodable:  # whatever is wrong with it, there is a way without
            table = None
        sound = _count_sound_points(data, header, _layers_per_chunk(records[0].record_data), table)
    return Sound(min(sound, header.point_count), table is not None)


def _chunk_table(file: BinaryIO, data: mmap, header: Any, vlr: Any) -> list[tuple[int, int]] | None:
    """Read the points and bytes of each chunk, unless they contradict the file."""
    start = header.offset_to_point_data
    (table_start,) = struct.unpack_from("<q", data, start)
    if table_start <= start:  # written to a pipe: the position follows the table
        (table_start,) = struct.unpack_from("<q", data, len(data) - 8)
    if not start + 8 <= table_start <= len(data) - 8:
        return None
    (chunks,) = struct.unpack_from("<I", data, table_start + 4)
    if vlr.uses_variable_size_chunks():
        is_possible = chunks <= header.point_count
    else:
        is_possible = chunks == -(-header.point_count // vlr.chunk_size())
    if not is_possible:
        return None
    file.seek(start)
    table: list[tuple[int, int]] = lazrs.read_chunk_table(file, vlr)
    return table if sum(size for _, size in table) == table_start - start - 8 else None


def _count_sound_points(data: mmap, header: Any, layers: int, table: list[tuple[int, int]] | None) -> int:
    """Count the points in front of the first chunk whose layers do not fit into the file.

    Chunks of the older, unlayered kind claim nothing.
    """
    if layers == 0:
        return int(header.point_count)
    layout = struct.Struct(f"<{1 + layers}I")
    first = header.point_format.size  # a chunk starts with its first point, uncompressed
    at, counted, chunk = header.offset_to_point_data + 8, 0, 0
    while counted < header.point_count and (table is None or chunk < len(table)):
        if at + first + layout.size > len(data):
            break
        count, *sizes = layout.unpack_from(data, at + first)
        size = first + layout.size + sum(sizes)
        if count == 0 or at + size > len(data) or (table is not None and size != table[chunk][1]):
            break
        at, counted, chunk = at + size, counted + count, chunk + 1
    return counted


def _layers_per_chunk(record_data: bytes) -> int:
    """Read from the laszip record how many compressed layers a chunk has; 0 for the unlayered kind."""
    (compressor,) = struct.unpack_from("<H", record_data)
    if compressor != _LAYERED:
        return 0
    (count,) = struct.unpack_from("<H", record_data, _ITEMS_AT)
    items = [struct.unpack_from("<HH", record_data, _ITEMS_AT + 2 + 6 * index) for index in range(count)]
    return sum(size if kind == _EXTRA_BYTES_ITEM else _LAYERS_OF_ITEM.get(kind, 0) for kind, size in items)
