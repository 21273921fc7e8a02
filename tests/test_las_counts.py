"""Headers of LAS and LAZ that contradict the file, or hold numbers that are of no use."""

from __future__ import annotations

import errno
import struct
import warnings
from typing import TYPE_CHECKING

import laspy
import numpy as np
import pytest

from reference import laz_files
from streamseg.errors import FileError, StreamsegWarning
from streamseg.io import las_blocks, open_cloud
from streamseg.io.las_box import Box

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

OLD_COUNT, COUNT = ("<I", 107), ("<Q", 247)


def with_field(path: Path, out: Path, *fields: tuple[str, int, object]) -> Path:
    raw = bytearray(path.read_bytes())
    for layout, at, value in fields:
        struct.pack_into(layout, raw, at, value)
    out.write_bytes(raw)
    return out


def points_of(path: Path) -> tuple[int, str | None]:
    cloud = open_cloud(path)
    return sum(len(chunk.points) for chunk in cloud.chunks()), cloud.damage


@pytest.fixture
def las(data: Path) -> laspy.LasData:
    return laz_files.clip(data / "als" / "topography.laz", 10_000)


def test_a_las_that_holds_more_points_than_announced_is_told(las: laspy.LasData, tmp_path: Path) -> None:
    las.write(str(tmp_path / "a.las"))
    path = with_field(tmp_path / "a.las", tmp_path / "b.las", (*OLD_COUNT, 9_000))
    count, damage = points_of(path)
    assert count == 9_000
    assert (
        damage == "b.las holds up to 1,000 points more than the 9,000 that its header announces; only these were read"
    )


def test_what_follows_the_points_by_right_is_no_point(data: Path, tmp_path: Path) -> None:
    las = laz_files.clip(data / "als" / "lidarhd_77050_627755.laz", 1_000)
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("somebody", 7, "", bytes(5_000))])
    las.write(str(tmp_path / "a.las"))
    assert points_of(tmp_path / "a.las") == (1_000, None)
    assert points_of(with_field(tmp_path / "a.las", tmp_path / "b.las", (*COUNT, 999)))[1] is not None


def test_a_las_that_announces_none_is_refused_with_a_reason(las: laspy.LasData, tmp_path: Path) -> None:
    las.write(str(tmp_path / "a.las"))
    las.write(str(tmp_path / "a.laz"))
    for name in ("a.las", "a.laz"):
        path = with_field(tmp_path / name, tmp_path / f"none{name}", (*OLD_COUNT, 0))
        with pytest.raises(FileError, match=f"none{name} announces 0 points in its header, but"):
            open_cloud(path)


@pytest.mark.parametrize(("announced", "read", "more"), [(7_000, 7_000, 5_000), (3_000, 3_000, 9_000)])
def test_a_chunk_table_with_more_chunks_than_announced_is_told(
    las: laspy.LasData, tmp_path: Path, announced: int, read: int, more: int
) -> None:
    whole = laz_files.write(tmp_path / "a.laz", las, 3_000)
    path = with_field(whole.path, tmp_path / "b.laz", (*OLD_COUNT, announced))
    count, damage = points_of(path)
    assert count == read
    assert f"b.laz holds up to {more:,} points more than the {announced:,}" in str(damage)
    assert np.array_equal(np.concatenate([c.points for c in open_cloud(path).chunks()]), whole.steps[:read])


@pytest.mark.parametrize("announced", [1, 45_000, 60_000, 97_000])
def test_a_chunk_that_is_decoded_in_several_pieces_ends_where_announced(
    las: laspy.LasData, tmp_path: Path, announced: int
) -> None:
    las.points = las.points[np.tile(np.arange(10_000), 18)]
    las.X = np.arange(180_000)
    whole = laz_files.write(tmp_path / "a.laz", las, 60_000)
    assert whole.records[:60_000].nbytes > 1 << 20
    path = with_field(whole.path, tmp_path / "b.laz", (*OLD_COUNT, announced))
    for _ in range(2):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StreamsegWarning)
            points = np.concatenate([chunk.points for chunk in open_cloud(path).chunks()])
        assert np.array_equal(points, whole.steps[:announced])


@pytest.mark.parametrize("announced", [10_500, 20_000, 4_000_000_000])
def test_a_laz_that_holds_fewer_points_than_announced_is_told(
    las: laspy.LasData, tmp_path: Path, announced: int
) -> None:
    whole = laz_files.write(tmp_path / "a.laz", las, 3_000)
    path = with_field(whole.path, tmp_path / "b.laz", (*OLD_COUNT, announced))
    cloud = open_cloud(path)
    points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert "b.laz is damaged after point" in str(cloud.damage)
    assert f"of {announced:,}" in str(cloud.damage)
    assert np.array_equal(points[:9_000], whole.steps[:9_000])


@pytest.mark.parametrize(
    ("point_format", "chunks"), [(6, 4_000), (6, [1_000, 8_000, 1_000]), (1, [1_000, 8_000, 1_000])]
)
def test_chunks_that_say_their_counts_are_believed(
    data: Path, tmp_path: Path, point_format: int, chunks: int | list[int]
) -> None:
    las = laz_files.clip(data / "als" / "lidarhd_77050_627755.laz", 10_000, 6)
    if point_format == 1:
        las = laz_files.clip(data / "als" / "topography.laz", 10_000)
    whole = laz_files.write(tmp_path / "a.laz", las, chunks)
    field = COUNT if point_format == 6 else OLD_COUNT
    for announced in (9_000, 1, 0):
        fields = [(*field, announced)] + [(*OLD_COUNT, 0)] * (point_format == 6)
        cloud = open_cloud(with_field(whole.path, tmp_path / "b.laz", *fields))
        assert cloud.point_count == 10_000
        with pytest.warns(StreamsegWarning, match=f"announces {announced:,} points .* holds 10,000; all are read"):
            points = np.concatenate([chunk.points for chunk in cloud.chunks()])
        assert np.array_equal(points, whole.steps)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("wrong", [COUNT, OLD_COUNT])
def test_of_two_counts_the_one_that_fits_is_taken(
    data: Path, tmp_path: Path, suffix: str, wrong: tuple[str, int]
) -> None:
    las = laz_files.clip(data / "als" / "lidarhd_77050_627755.laz", 10_000)
    las.write(str(tmp_path / f"a{suffix}"))
    right = OLD_COUNT if wrong == COUNT else COUNT
    path = with_field(tmp_path / f"a{suffix}", tmp_path / f"b{suffix}", (*wrong, 9_999), (*right, 10_000))
    with pytest.warns(StreamsegWarning, match="points in one field of its header, and .* in another; 10,000 are read"):
        assert points_of(path) == (10_000, None)


@pytest.mark.parametrize(
    ("at", "value"), [(131, 1e300), (131, 5e-324), (139, 1e7), (155, 1e300), (163, -1e13), (147, float("nan"))]
)
def test_scales_and_offsets_that_nothing_can_be_done_with_are_refused(
    las: laspy.LasData, tmp_path: Path, at: int, value: float
) -> None:
    las.write(str(tmp_path / "a.las"))
    with pytest.raises(FileError, match=r"has a damaged header: scale .* must be finite numbers"):
        open_cloud(with_field(tmp_path / "a.las", tmp_path / "b.las", ("<d", at, value)))


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (0, 7, "compressor 7"),
        (2, 1, "coder 1"),
        (34, 99, "items 99.2"),
        (38, 9, "items 6.9"),
        (12, None, "chunks of 0 points"),
        (36, 21, "items 6.2"),
    ],
)
def test_a_compression_that_is_not_known_is_named(
    las: laspy.LasData, tmp_path: Path, at: int, value: int | None, said: str
) -> None:
    las.write(str(tmp_path / "a.laz"))
    raw = (tmp_path / "a.laz").read_bytes()
    with laspy.open(tmp_path / "a.laz") as reader:
        record = raw.index(bytes(reader.header.vlrs.get("LasZipVlr")[0].record_data))
    layout, value = ("<I", 0) if value is None else ("<H", value)
    with pytest.raises(FileError, match=said):
        open_cloud(with_field(tmp_path / "a.laz", tmp_path / "b.laz", (layout, record + at, value)))


def test_a_laz_of_one_chunk_as_the_first_laszip_wrote_it_is_read(data: Path) -> None:
    path = data / "odd" / "pointwise-laszip-1.2r0.laz"
    cloud = open_cloud(path)
    with pytest.warns(StreamsegWarning, match="is compressed in one piece"):
        points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    truth = laspy.read(path, laz_backend=laspy.LazBackend.Laszip)
    assert len(points) == 1_065
    assert cloud.damage is None
    np.testing.assert_array_equal(points, np.column_stack([truth.X, truth.Y, truth.Z]))


def test_all_that_is_odd_of_a_file_is_told(data: Path, tmp_path: Path) -> None:
    path = data / "odd" / "pointwise-laszip-1.2r0.laz"
    with laspy.open(path) as reader, path.open("rb") as file:
        body = las_blocks.body_of(file, path, reader.header, Box(reader.header), 1_000)
    assert len(body.remarks) == 2
    assert "is compressed in one piece" in body.remarks[0]
    assert "1,065 points in one field of its header, and 1,000 in another; 1,065 are read" in body.remarks[1]


def test_no_memory_is_no_damage_of_a_header(
    las: laspy.LasData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    las.write(str(tmp_path / "a.las"))
    for raised, told in ((MemoryError, MemoryError), (IndexError, FileError), (laspy.LaspyException, FileError)):
        monkeypatch.setattr("laspy.LasHeader.read_from", _raising(raised))
        with pytest.raises(told):
            open_cloud(tmp_path / "a.las")


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_what_the_system_refuses_to_read_is_one_sentence(
    las: laspy.LasData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    path = tmp_path / f"a{suffix}"
    las.write(str(path))
    cloud = open_cloud(path)
    place = "las_plain.PlainPoints" if suffix == ".las" else "laz.CompressedPoints"
    method = "_read" if suffix == ".las" else "_decoded"
    monkeypatch.setattr(f"streamseg.io.{place}.{method}", _raising(OSError(errno.EIO, "Input/output error")))
    with pytest.raises(FileError, match=f"a{suffix} cannot be read: Input/output error"):
        list(cloud.chunks())


def _raising(error: type[Exception] | Exception) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize("point_format", [0, 1, 6, 7])
def test_a_chunk_of_equal_points_is_believed(tmp_path: Path, point_format: int) -> None:
    """Nothing takes less room than points that are all the same."""
    las = laspy.LasData(laspy.LasHeader(point_format=point_format, version="1.4"))
    las.X = np.full(200_000, 7)
    whole = laz_files.write(tmp_path / "a.laz", las, [200_000])
    assert whole.starts[1] - whole.starts[0] < 1_000
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert points_of(whole.path) == (200_000, None)


@pytest.mark.parametrize("claimed", [(1 << 32) - 2, 200_000_000])
def test_a_count_that_a_chunk_has_no_room_for_is_damage(data: Path, tmp_path: Path, claimed: int) -> None:
    las = laz_files.clip(data / "als" / "lidarhd_77050_627755.laz", 6_000, 6)
    whole = laz_files.write(tmp_path / "a.laz", las, [2_000, 2_000, 2_000])
    at = whole.starts[1] + whole.records.itemsize
    cloud = open_cloud(with_field(whole.path, tmp_path / "b.laz", ("<I", at, claimed)))
    assert cloud.point_count == 6_000
    assert sum(len(chunk.points) for chunk in cloud.chunks()) == 2_000
    assert "is damaged after point 2,000 of 6,000" in str(cloud.damage)
