"""Damaged files: every point before the damage is read, and one sentence tells the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, BinaryIO

import laspy
import lazrs
import numpy as np
import pytest

from streamseg.errors import FileError, InvalidInput, StreamsegError, StreamsegWarning
from streamseg.io import open_cloud, write_labelled

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


class Ones:
    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return np.ones(stop - start, np.int64), np.ones(stop - start, np.bool_)


def steps(path: Path) -> NDArray[np.float64]:
    points = laspy.read(path).points
    return np.column_stack([points[axis] for axis in "XYZ"]).astype(np.float64)


def header_of(path: Path) -> tuple[laspy.LasHeader, bytes]:
    """Return the header and what the laszip record says."""
    with path.open("rb") as file:
        header = laspy.LasHeader.read_from(file)
    return header, next(vlr.record_data for vlr in header.vlrs if "laszip" in vlr.user_id)


class Forward:
    """A file that cannot seek, so that lazrs does without the chunk table."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file

    def read(self, size: int) -> bytes:
        return self.file.read(size)

    def seek(self, *_: int) -> int:
        raise OSError


def count_decodable(path: Path) -> int:
    """Be the oracle: decode point by point until it fails."""
    header, record_data = header_of(path)
    record = bytearray(header.point_format.size)
    with path.open("rb") as file:
        file.seek(header.offset_to_point_data)
        decoder = lazrs.LasZipDecompressor(Forward(file), record_data)
        for count in range(header.point_count):
            try:
                decoder.decompress_many(record)
            except lazrs.LazrsError:  # noqa: PERF203 - where it fails is the answer
                return count
    return header.point_count


@pytest.mark.parametrize("fraction", [0.001, 0.01, 0.2, 0.5, 0.83, 0.99, 0.9999])
@pytest.mark.parametrize("name", ["isprs/CSite3", "als/autzen_trim", "als/mixed_conifer", "als/lidarhd_77050_627755"])
def test_a_truncated_laz_gives_every_point_that_can_be_decoded(
    data: Path, tmp_path: Path, name: str, fraction: float
) -> None:
    whole = data / f"{name}.laz"
    raw, path = whole.read_bytes(), tmp_path / "cut.laz"
    path.write_bytes(raw[: int(len(raw) * fraction)])
    announced = header_of(whole)[0].point_count
    if len(path.read_bytes()) < header_of(whole)[0].offset_to_point_data:
        with pytest.raises(FileError, match=r"cut off (before its first point|inside its header)"):
            open_cloud(path)
        return
    cloud = open_cloud(path)
    expected = count_decodable(path)
    if expected == 0:
        with pytest.raises(FileError, match=f"none of its {announced:,} points could be read"):
            list(cloud.chunks())
        return
    points = np.concatenate([chunk.points for chunk in cloud.chunks(30_000)])
    assert len(points) == expected
    assert np.array_equal(points, steps(whole)[:expected])
    assert cloud.damage is not None
    assert cloud.damage.startswith(
        f"cut.laz is damaged after point {expected:,} of {announced:,}; the {expected:,} points before it were read"
    )


def test_a_laz_without_its_chunk_table_alone_is_complete(data: Path, tmp_path: Path) -> None:
    whole, path = data / "isprs" / "CSite3.laz", tmp_path / "cut.laz"
    path.write_bytes(whole.read_bytes()[:-4])
    cloud = open_cloud(path)
    with pytest.warns(StreamsegWarning, match="cut.laz has lost its chunk table, .*; all 377,028 points were found"):
        points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert np.array_equal(points, steps(whole))
    assert cloud.damage is None


def test_damage_in_the_middle_keeps_the_chunks_before_it(data: Path, tmp_path: Path) -> None:
    whole, path = data / "als" / "lidarhd_77050_627755.laz", tmp_path / "hit.laz"
    raw = bytearray(whole.read_bytes())
    header, record_data = header_of(whole)
    start = header.offset_to_point_data
    with whole.open("rb") as file:
        file.seek(start)
        first_chunk = lazrs.read_chunk_table(file, lazrs.LazVlr(record_data))[0][1]
    # In front of a chunk's layers stand its first point, its number of points and the sizes of the layers.
    at = start + 8 + first_chunk + header.point_format.size + 4
    raw[at : at + 40] = b"\xff" * 40
    path.write_bytes(raw)
    cloud = open_cloud(path)
    points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert np.array_equal(points, steps(whole)[: len(points)])
    assert len(points) == 50_000
    assert f"hit.laz is damaged after point {len(points):,} of 73,355" in str(cloud.damage)


def test_a_truncated_las_gives_every_whole_record(data: Path, tmp_path: Path) -> None:
    las = laspy.read(data / "als" / "mixed_conifer.laz")
    whole, path = tmp_path / "whole.las", tmp_path / "cut.las"
    las.write(str(whole))
    with laspy.open(whole) as reader:
        size, start = reader.header.point_format.size, reader.header.offset_to_point_data
    for kept in (1, 999, 30_000):
        path.write_bytes(whole.read_bytes()[: start + kept * size + size - 1])
        cloud = open_cloud(path)
        points = np.concatenate([chunk.points for chunk in cloud.chunks(777)])
        assert np.array_equal(points, steps(whole)[:kept])
        assert f"damaged after point {kept:,} of 37,657" in str(cloud.damage)


def test_what_can_be_read_of_a_damaged_file_can_be_written(data: Path, tmp_path: Path) -> None:
    whole, path = data / "als" / "mixed_conifer.laz", tmp_path / "cut.laz"
    path.write_bytes(whole.read_bytes()[:100_000])
    cloud = open_cloud(path)
    with pytest.warns(StreamsegWarning, match="cut.laz is damaged after point"):
        count = write_labelled(cloud, tmp_path / "out.laz", Ones())
    assert count == count_decodable(path)
    assert np.array_equal(steps(tmp_path / "out.laz"), steps(whole)[:count])
    assert "cut.laz is damaged" in str(cloud.damage)


def test_a_damaged_file_does_not_take_the_next_one_with_it(data: Path, tmp_path: Path) -> None:
    whole, path = data / "als" / "mixed_conifer.laz", tmp_path / "cut.laz"
    path.write_bytes(whole.read_bytes()[:100_000])
    cloud, read = open_cloud([path, whole]), count_decodable(path)
    points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert np.array_equal(points, np.concatenate([steps(whole)[:read], steps(whole)]))
    assert str(cloud.damage).startswith("cut.laz is damaged after point")


@pytest.mark.filterwarnings("default::streamseg.errors.StreamsegWarning")
@pytest.mark.parametrize("seed", range(30))
def test_garbled_bytes_end_in_words_and_never_in_a_panic(data: Path, tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    raw = np.frombuffer((data / "als" / "mixed_conifer.laz").read_bytes(), np.uint8).copy()
    start = int(random.integers(0, 700 if seed % 2 else len(raw)))
    raw[start : start + 40] = random.integers(0, 256, len(raw[start : start + 40]))
    path = tmp_path / "garbled.laz"
    path.write_bytes(raw.tobytes())
    try:
        cloud = open_cloud(path)
        read = sum(len(chunk.points) for chunk in cloud.chunks(10_000))
    except StreamsegError as error:
        said = str(error)
    else:
        said = path.name if read == cloud.point_count else str(cloud.damage)
    assert path.name in said


def test_truncated_npy_by_rows_and_by_columns(tmp_path: Path) -> None:
    points = np.arange(3000.0).reshape(1000, 3)
    path = tmp_path / "a.npy"
    np.save(path, points)
    path.write_bytes(path.read_bytes()[: 128 + 24 * 600 + 23])
    cloud = open_cloud(path)
    assert np.array_equal(np.concatenate([chunk.points for chunk in cloud.chunks(7)]), points[:600])
    assert "a.npy is damaged after point 600 of 1,000" in str(cloud.damage)
    np.save(path, np.asfortranarray(points))
    path.write_bytes(path.read_bytes()[: 128 + 8 * 2400])
    cloud = open_cloud(path)
    assert np.array_equal(np.concatenate([chunk.points for chunk in cloud.chunks(7)]), points[:400])
    assert "damaged after point 400 of 1,000" in str(cloud.damage)


@pytest.mark.parametrize("name", ["a.las", "a.laz", "a.npy", "a.xyz"])
@pytest.mark.parametrize("content", [b"", b"\0\1\2\3 this is nothing at all \xff" * 50, None])
def test_what_is_no_cloud_is_refused(tmp_path: Path, name: str, content: bytes | None) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FileError, match=r"does not exist" if content is None else r"empty|is no ") as caught:
        open_cloud(path)
    assert str(path) in str(caught.value)
    assert isinstance(caught.value, OSError)


def test_zero_points_are_refused(tmp_path: Path) -> None:
    laspy.LasData(laspy.LasHeader()).write(str(tmp_path / "a.las"))
    np.save(tmp_path / "a.npy", np.zeros((0, 3)))
    (tmp_path / "a.csv").write_text("x,y,z\n")
    for name in ("a.las", "a.npy", "a.csv"):
        with pytest.raises(InvalidInput, match=f"{name} has no points"):
            open_cloud(tmp_path / name)


def test_a_folder_and_an_unknown_suffix_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.las").mkdir()
    with pytest.raises(FileError, match="cannot be read"):
        open_cloud(tmp_path / "a.las")
    (tmp_path / "a.e57").touch()
    with pytest.raises(InvalidInput, match=r"ends in '\.e57', which is not known; known are \.las"):
        open_cloud(tmp_path / "a.e57")
    with pytest.raises(InvalidInput, match="no input file was given"):
        open_cloud([])
