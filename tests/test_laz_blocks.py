"""LAZ files of which 4 KB are overwritten: what is read is right, and what is not read is told.

STREAMSEG_TORTURE=1000 tries that many files.
"""

from __future__ import annotations

import os
import struct
import warnings
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import laspy
import numpy as np
import pytest

from reference import laz_files
from streamseg import Proximity, segment_file
from streamseg.errors import FileError, StreamsegWarning
from streamseg.io import laz_decoder, open_cloud

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from reference.laz_files import LazFile

FILES = int(os.environ.get("STREAMSEG_TORTURE", "40"))
BLOCK = 4096

CLIPS = [
    ("als/autzen_trim", 20_000, None, 6_000),
    ("als/topography", 24_000, None, 50_000),
    ("als/mixed_conifer", 20_000, None, [500, 4_000, 9_000, 6_500]),
    ("isprs/CSite3", 30_000, 2, 10_000),
    ("als/lidarhd_77050_627755", 30_000, None, 9_000),
    ("als/lidarhd_77055_627760", 24_000, 6, [2_000, 20_000, 1, 1_999]),
    ("als/lidarhd_77050_627760", 20_000, 7, 50_000),
    ("als/lidarhd_77055_627755", 12_000, 10, 5_000),
]


@pytest.fixture(scope="module")
def clips(data: Path, tmp_path_factory: pytest.TempPathFactory) -> list[LazFile]:
    folder = tmp_path_factory.mktemp("clips")
    return [
        laz_files.write(folder / f"{index}.laz", laz_files.clip(data / f"{name}.laz", points, point_format), chunks)
        for index, (name, points, point_format, chunks) in enumerate(CLIPS)
    ]


class Read(NamedTuple):
    """What came of a file."""

    points: NDArray[np.float64]
    told: str | None
    """Damage or refusal."""
    warned: list[str]


def read(path: Path) -> Read:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            cloud = open_cloud(path)
            points = np.concatenate([chunk.points for chunk in cloud.chunks()])
            told = cloud.damage
        except FileError as error:
            points, told = np.empty((0, 3)), str(error)
    return Read(points, told, [str(warning.message) for warning in caught])


def overwritten(clip: LazFile, at: int, block: bytes, path: Path) -> Path:
    raw = bytearray(clip.path.read_bytes())
    block = block[: len(raw) - at]
    raw[at : at + len(block)] = block
    path.write_bytes(raw)
    return path


def test_a_block_of_damage_is_told_and_what_is_read_is_right(clips: list[LazFile], tmp_path: Path) -> None:
    told = 0
    for seed in range(FILES):
        random = np.random.default_rng(seed)
        clip = clips[seed % len(clips)]
        at = int(random.integers(clip.starts[0] - 8, clip.path.stat().st_size))
        block = (bytes(BLOCK), b"\xff" * BLOCK, random.bytes(BLOCK))[seed // len(clips) % 3]
        seen = read(overwritten(clip, at, block, tmp_path / "hit.laz"))
        which = f"seed {seed}, {clip.path.name}, byte {at}"
        assert np.array_equal(seen.points, clip.steps[: len(seen.points)]), which
        assert len(seen.points) >= clip.points_before(at), which
        assert seen.told or len(seen.points) == len(clip.records), which
        told += seen.told is not None
    assert told > FILES // 2


def test_damage_in_every_chunk_leaves_exactly_the_chunks_before_it(clips: list[LazFile], tmp_path: Path) -> None:
    noise = np.random.default_rng(1).bytes(200)
    for clip in clips:
        for start, end in pairwise(clip.starts):
            at = (start + end) // 2 - 100
            seen = read(overwritten(clip, at, noise[: (end - start) // 2], tmp_path / "hit.laz"))
            assert seen.told is not None, (clip.path.name, start)
            assert len(seen.points) == clip.points_before(at), (clip.path.name, start)
            assert np.array_equal(seen.points, clip.steps[: len(seen.points)])


@pytest.mark.parametrize("chunk", [0, 1])
def test_a_damaged_layer_is_told_whatever_a_run_needs(clips: list[LazFile], tmp_path: Path, chunk: int) -> None:
    clip = clips[4]
    size, layers, start = clip.records.itemsize, 11, clip.starts[chunk]
    (_, *sizes) = struct.unpack_from(f"<{1 + layers}I", clip.path.read_bytes(), start + size)
    intensity = start + size + 4 * (1 + layers) + sum(sizes[:4])
    path = overwritten(clip, intensity + 50, b"\xff" * 60, tmp_path / "hit.laz")
    cloud = open_cloud(path)
    if chunk == 0:
        with pytest.raises(FileError, match="none of its 30,000 points could be read"):
            list(cloud.chunks())
        return
    for attributes in ((), ("intensity",), ()):
        assert sum(len(chunk.points) for chunk in cloud.chunks(attributes=attributes)) == 9_000
        assert cloud.damage is not None
    with pytest.warns(StreamsegWarning, match=r"hit\.laz is damaged after point 9,000 of") as caught:
        outcome = segment_file(path, tmp_path / "out.laz", Proximity(1.0))
    assert len(caught) == 1
    assert outcome.damage == str(caught[0].message)
    assert outcome.points == 9_000


def test_a_chunk_that_another_encoder_has_written_is_proven_by_where_it_ends(clips: list[LazFile]) -> None:
    for clip, layered in ((clips[0], False), (clips[4], True)):
        raw, record = clip.path.read_bytes(), _laszip_record(clip.path)
        request = laz_decoder.Request(
            laz_decoder.CHUNK,
            bytes(clip.path),
            record,
            clip.starts[0],
            clip.starts[1] - clip.starts[0],
            clip.counts[0],
            clip.records.itemsize,
        )
        stored = raw[clip.starts[0] : clip.starts[1]]
        assert laz_decoder._is_same(stored, stored, request)
        # A byte early on makes all that follows another; one at the end is damage.
        early = stored[:400] + bytes([stored[400] ^ 1]) + stored[401:-200] + bytes(200)
        assert not laz_decoder._is_same(stored, early, request)
        assert not laz_decoder._is_same(stored, b"", request)
        head = clip.records.itemsize + 4 * 12
        end = head + struct.unpack_from("<I", stored, clip.records.itemsize + 4)[0] - 1 if layered else len(stored) - 1
        late = stored[:end] + bytes([stored[end] ^ 1]) + stored[end + 1 :]
        with pytest.raises(laz_decoder.Damage, match="do not end as they should"):
            laz_decoder._is_same(stored, late, request)


def _laszip_record(path: Path) -> bytes:
    with laspy.open(path) as reader:
        return bytes(reader.header.vlrs.get("LasZipVlr")[0].record_data)


@pytest.mark.parametrize("index", range(len(CLIPS)))
def test_sound_files_are_read_as_they_are(clips: list[LazFile], index: int) -> None:
    clip = clips[index]
    cloud = open_cloud(clip.path)
    source = cloud.sources[0]
    records = np.concatenate([block.array for block in source.records(7_000)])  # type: ignore[attr-defined]
    assert records.tobytes() == clip.records.tobytes()
    assert np.array_equal(np.concatenate([chunk.points for chunk in cloud.chunks(7_000)]), clip.steps)
    assert cloud.damage is None


@pytest.mark.parametrize("index", [index for index, clip in enumerate(CLIPS) if not isinstance(clip[3], list)])
def test_points_are_found_without_the_chunk_table(clips: list[LazFile], tmp_path: Path, index: int) -> None:
    clip = clips[index]
    raw = clip.path.read_bytes()
    place, end = clip.starts[0] - 8, clip.starts[-1]
    lost = {
        "overwritten": raw[:end] + b"\xff" * (len(raw) - end),
        "cut off": raw[:end],
        "place lost": raw[:place] + b"\xff" * 8 + raw[place + 8 :],
        "place wrong": raw[:place] + struct.pack("<q", end - 700) + raw[place + 8 :],
    }
    for how, content in lost.items():
        path = tmp_path / "lost.laz"
        path.write_bytes(content)
        seen = read(path)
        assert np.array_equal(seen.points, clip.steps), how
        assert seen.told is None, how
        # A layered file whose table is there, but not where it should be, needs none.
        assert len(seen.warned) == 1 or how.startswith("place"), how
        assert all("has lost its chunk table" in said for said in seen.warned), how


def test_damage_beside_a_lost_chunk_table_is_told(clips: list[LazFile], tmp_path: Path) -> None:
    for clip in clips[:2]:
        raw = bytearray(clip.path.read_bytes())
        raw[clip.starts[-1] - 600 :] = b"\0" * (len(raw) - clip.starts[-1] + 600)
        path = tmp_path / "hit.laz"
        path.write_bytes(raw)
        seen = read(path)
        assert len(seen.points) == sum(clip.counts[:-1])
        assert np.array_equal(seen.points, clip.steps[: len(seen.points)])
        assert seen.told is not None
    clip = clips[0]
    raw = bytearray(clip.path.read_bytes())
    raw[clip.starts[2] + 900 : clip.starts[2] + 1900] = b"\xff" * 1000
    raw[clip.starts[-1] :] = b"\xff" * (len(raw) - clip.starts[-1])
    (tmp_path / "hit.laz").write_bytes(raw)
    seen = read(tmp_path / "hit.laz")
    assert np.array_equal(seen.points, clip.steps[: sum(clip.counts[:2])])
    assert seen.told is not None


def test_a_wrong_box_loses_nothing_and_is_told_once(clips: list[LazFile], tmp_path: Path) -> None:
    raw = bytearray(clips[0].path.read_bytes())
    raw[179:227] = bytes(48)
    (tmp_path / "zero.laz").write_bytes(raw)
    cloud = open_cloud(tmp_path / "zero.laz")
    with pytest.warns(StreamsegWarning, match="20,000 of the 20,000 points .* the box is probably wrong") as caught:
        points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert len(caught) == 1
    assert np.array_equal(points, clips[0].steps)
    assert len(list(cloud.chunks())) == 1  # told already
    assert cloud.damage is None


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_stray_points_are_counted(data: Path, tmp_path: Path, suffix: str) -> None:
    las = laz_files.clip(data / "als" / "topography.laz", 5_000)
    path = tmp_path / f"stray{suffix}"
    las.write(str(path))
    raw = bytearray(path.read_bytes())
    high = float(np.sort(np.asarray(las.x))[-8] - las.header.scales[0] * 3)
    struct.pack_into("<d", raw, 179, high)
    path.write_bytes(raw)
    outside = int((np.asarray(las.X) > (high - las.header.offsets[0]) / las.header.scales[0] + 1).sum())
    assert 7 <= outside < 100
    with pytest.warns(StreamsegWarning, match=f"^{outside} of the 5,000 points of stray.* lie outside .*stray points"):
        points = np.concatenate([chunk.points for chunk in open_cloud(path).chunks()])
    assert np.array_equal(points, laz_files.steps(laspy.read(path).points.array))
