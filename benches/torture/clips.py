"""Clips of measured clouds in every point format, uncompressed and in chunks of several sizes."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import lazrs
import numpy as np
from laspy._compression.lazrsbackend import LazrsPointWriter
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from measuring import DATA

_MEASURED = (
    "als/autzen_trim.laz",
    "als/topography.laz",
    "als/lidarhd_77050_627755.laz",
    "als/mixed_conifer.laz",
    "isprs/CSite3.laz",
    "tls/lone_star.laz",
)
_WAVEFORMS = (4, 5, 9, 10)
_CHUNK_SIZES = (1_000, 5_000, 50_000)
_CHUNK_SIZE_AT = 12


class Clip(NamedTuple):
    """A clip and what is true of it."""

    path: Path
    steps: NDArray[np.int32]
    """Raw X, Y, Z, (n, 3)."""
    distance: float
    """A distance that suits it."""


def read(path: Path) -> laspy.LasData:
    """Read a file without threads: a process that has used them cannot be forked safely."""
    return laspy.read(path, laz_backend=laspy.LazBackend.Lazrs)


def write_clips(folder: Path, clips_per_cloud: int = 4) -> None:
    """Write clips of at most 50,000 points into the folder, LAS and LAZ, in all point formats in turn."""
    number = 0
    random = np.random.default_rng(1)
    for name in _MEASURED:
        las = read(DATA / name)
        for _ in range(clips_per_cloud):
            count = int(random.choice((3_000, 12_000, 20_000, 50_000)))
            first = int(random.integers(0, max(1, len(las.points) - count)))
            for compressed in (False, True):
                point_format = number % 11
                chunk = _CHUNK_SIZES[number % len(_CHUNK_SIZES)]
                suffix = f"laz_{chunk}.laz" if compressed else "las.las"
                path = folder / f"clip-{number:03}-{point_format}-{suffix}"
                _write(path, las, slice(first, first + count), point_format, chunk if compressed else 0)
            number += 1


def clips(folder: Path, suffix: str) -> list[Path]:
    """List the clips of one kind."""
    return sorted(folder.glob(f"clip-*{suffix}"))


def opened(path: Path) -> Clip:
    """Read a clip."""
    las = read(path)
    spacing = float(np.sqrt(np.prod(np.ptp(las.xyz[:, :2], axis=0)) / len(las.points)))
    return Clip(path, np.column_stack([las.X, las.Y, las.Z]), 2.5 * spacing)


def _write(path: Path, source: Any, part: slice, point_format: int, chunk: int) -> None:
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.3")
    header.scales, header.offsets = source.header.scales, source.header.offsets
    header.global_encoding.wkt = point_format > 5
    header.add_extra_dim(laspy.ExtraBytesParams("height", "i2", "above ground", no_data=[-99]))
    las = laspy.LasData(header)
    las.points = laspy.ScaleAwarePointRecord.zeros(len(source.points[part]), header=header)
    for name in set(las.point_format.dimension_names) & set(source.point_format.dimension_names):
        las[name] = source[name][part]
    if point_format in _WAVEFORMS:
        count = len(las.points)
        las.wavepacket_index = np.ones(count, "u1")
        las.wavepacket_offset = np.arange(count, dtype="u8") * 16 + 60
        las.wavepacket_size = np.full(count, 16, "u4")
        header.vlrs.append(laspy.VLR("LASF_Spec", 100, "", struct.pack("<BBIIdd", 8, 0, 16, 1000, 1.0, 0.0)))
    las.header.vlrs.append(laspy.VLR("notes", 7, "of the survey", b"flown in spring" * 5))
    with open(path, "wb") as file:
        writer = _Writer(file, las.header, chunk) if chunk else laspy.LasWriter(file, las.header, closefd=False)
        writer.write_points(las.points)
        writer.close()


class _ChunkWriter(LazrsPointWriter):
    """Compresses in chunks of another size than lazrs' own."""

    def __init__(self, file: Any, point_format: Any, chunk: int) -> None:
        super().__init__(file, point_format, parallel=False)
        record = bytearray(self.vlr.record_data())
        struct.pack_into("<I", record, _CHUNK_SIZE_AT, chunk)
        self.vlr = lazrs.LazVlr(bytes(record))


class _Writer(laspy.LasWriter):
    def __init__(self, file: Any, header: Any, chunk: int) -> None:
        self._chunk = chunk
        super().__init__(file, header, do_compress=True, closefd=False)

    def _create_laz_backend(self, laz_backends: Any) -> Any:  # noqa: ARG002
        return _ChunkWriter(self.dest, self.header.point_format, self._chunk)
