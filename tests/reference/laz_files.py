"""LAZ files in layouts that laspy does not write: chunks of any size."""

from __future__ import annotations

import struct
from io import BytesIO
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import laspy
import lazrs
import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

VARIABLE = (1 << 32) - 1
_CHUNK_SIZE_AT = 12


class LazFile(NamedTuple):
    """A file, and what is in it."""

    path: Path
    records: NDArray[np.void]
    starts: list[int]
    """Where each chunk starts, and where the last one ends."""
    counts: list[int]
    """Points of each chunk."""

    @property
    def steps(self) -> NDArray[np.float64]:
        return steps(self.records)

    def points_before(self, at: int) -> int:
        """Count the points of the chunks that end before a byte."""
        return sum(count for count, end in zip(self.counts, self.starts[1:], strict=True) if end <= at)


def steps(records: NDArray[np.void]) -> NDArray[np.float64]:
    return np.column_stack([records[axis] for axis in "XYZ"]).astype(np.float64)


def clip(source: Path, points: int, point_format: int | None = None) -> laspy.LasData:
    """Take the first points of a file, in another point format if one is given."""
    las = laspy.read(source)
    las.points = las.points[:points]
    if point_format is not None and point_format != las.point_format.id:
        las = laspy.convert(las, point_format_id=point_format)
    return las


def write(path: Path, las: laspy.LasData, chunks: int | list[int]) -> LazFile:
    """Write chunks of so many points each; of a list, chunks that vary in size."""
    buffer = BytesIO()
    las.write(buffer, do_compress=True)
    records = np.array(las.points.array)
    with laspy.open(BytesIO(buffer.getvalue())) as reader:
        header = reader.header
        old = bytes(header.vlrs.get("LasZipVlr")[0].record_data)
    new = bytearray(old)
    struct.pack_into("<I", new, _CHUNK_SIZE_AT, VARIABLE if isinstance(chunks, list) else chunks)
    start = header.offset_to_point_data
    file = BytesIO()
    file.write(buffer.getvalue()[:start].replace(old, bytes(new)))
    compressor = lazrs.LasZipCompressor(file, lazrs.LazVlr(bytes(new)))
    counts = chunks if isinstance(chunks, list) else _even(len(records), chunks)
    if isinstance(chunks, list):
        edges = np.cumsum([0, *counts])
        compressor.compress_chunks([records[a:b].tobytes() for a, b in pairwise(edges)])
    else:
        compressor.compress_many(records.tobytes())
    compressor.done()
    path.write_bytes(file.getvalue())
    file.seek(start)
    table = lazrs.read_chunk_table(file, lazrs.LazVlr(bytes(new)))
    table = [(count, size) for count, size in table if count]  # lazrs ends with a chunk of no points
    starts = [start + 8, *(start + 8 + np.cumsum([size for _, size in table])).tolist()]
    return LazFile(path, records, starts, counts)


def _even(points: int, chunk: int) -> list[int]:
    return [min(chunk, points - at) for at in range(0, points, chunk)]
