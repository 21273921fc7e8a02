"""NumPy and text files: the variants people have, read in chunks and written with ids."""

from __future__ import annotations

from typing import TYPE_CHECKING

import laspy
import numpy as np
import pytest

from streamseg.errors import InvalidInput, StreamsegWarning
from streamseg.io import open_cloud, read_labels, write_labelled

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from streamseg.io import Cloud

POINTS = np.array([[1.5, 2.25, -3.0], [4.0, 5e3, 6.125], [-7.0, 8.0, 9.0], [10.0, 11.0, 12.0]])


class Labels:
    def __init__(self, missing: tuple[int, ...] = ()) -> None:
        self.missing = missing

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        points = np.arange(start, stop)
        return points * 10 - 1, ~np.isin(points, self.missing)


def points_of(cloud: Cloud, size: int = 3) -> NDArray[np.float64]:
    chunks = [chunk.points for chunk in cloud.chunks(size)]
    assert all(chunk.dtype == np.float64 and chunk.flags.c_contiguous and 0 < len(chunk) <= size for chunk in chunks)
    return np.concatenate(chunks)


@pytest.mark.parametrize("size", [1, 3, 100])
@pytest.mark.parametrize("dtype", ["f8", "f4", ">f8", "i4", "u2"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("columns", [3, 5])
def test_npy_tables(tmp_path: Path, size: int, dtype: str, order: str, columns: int) -> None:
    table = np.asarray(np.random.default_rng(3).integers(0, 1000, (100, columns)).astype(dtype), order=order)
    np.save(tmp_path / "a.npy", table)
    cloud = open_cloud(tmp_path / "a.npy")
    assert cloud.point_count == 100
    assert cloud.lattice.is_identity
    assert cloud.dimensions == ("x", "y", "z", "column_4", "column_5")[:columns]
    assert np.array_equal(points_of(cloud, size), table[:, :3].astype(float))
    if columns == 5:
        extra = [chunk.attributes["column_5"] for chunk in cloud.chunks(size, ["column_5"])]
        assert np.array_equal(np.concatenate(extra), table[:, 4])


def test_npy_with_named_fields(tmp_path: Path) -> None:
    table = np.zeros(4, [("gps_time", "f8"), ("z", "f4"), ("y", "f4"), ("x", "f4")])
    table["x"], table["y"], table["z"] = POINTS.T
    table["gps_time"] = np.arange(4)
    np.save(tmp_path / "a.npy", table)
    cloud = open_cloud(tmp_path / "a.npy")
    (chunk,) = cloud.chunks(attributes=["gps_time"])
    assert np.array_equal(chunk.points, POINTS)
    assert chunk.attributes["gps_time"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros(9), r"has shape \(9,\), expected \(n, 3\)"),
        (np.zeros((4, 2)), r"has shape \(4, 2\), expected \(n, 3\)"),
        (np.zeros((4, 3), complex), "holds complex128, expected numbers"),
        (np.zeros(4, [("x", "f8"), ("y", "f8")]), "needs the numeric fields x, y and z; it has x, y"),
    ],
)
def test_npy_that_holds_no_points_is_refused(tmp_path: Path, array: NDArray[np.generic], said: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(InvalidInput, match=said):
        open_cloud(tmp_path / "a.npy")


VARIANTS = {
    "blanks.xyz": "1.5 2.25 -3\n4 5e3 6.125\n-7 8 9\n10 11 12\n",
    "more_blanks.txt": "  1.5   2.25 -3\n  4  5e3  6.125\n -7 8 9 \n 10 11 12",
    "tabs.asc": "1.5\t2.25\t-3\n4\t5e3\t6.125\n-7\t8\t9\n10\t11\t12\n",
    "commas.csv": "1.5,2.25,-3\n4, 5e3, 6.125\n-7,8,9\n10,11,12\n",
    "semicolons.csv": "1.5;2.25;-3\n4;5e3;6.125\n-7;8;9\n10;11;12\n",
    "windows.csv": "x,y,z\r\n1.5,2.25,-3\r\n4,5e3,6.125\r\n-7,8,9\r\n10,11,12\r\n",
    "named.csv": '"X","Y","Z"\n1.5,2.25,-3\n4,5e3,6.125\n-7,8,9\n10,11,12\n',
    "reordered.csv": "time,z,y,x\n0,-3,2.25,1.5\n1,6.125,5e3,4\n2,9,8,-7\n3,12,11,10\n",
    "surveyed.csv": "id,Easting,Northing,Height\n1,1.5,2.25,-3\n2,4,5e3,6.125\n3,-7,8,9\n4,10,11,12\n",
    "short.csv": "H;N;E;h2\n-3;2.25;1.5;0\n6.125;5e3;4;0\n9;8;-7;0\n12;11;10;0\n",
    "cloudcompare.txt": "//X Y Z Intensity\n1.5 2.25 -3 7\n4 5e3 6.125 7\n-7 8 9 7\n10 11 12 7\n",
    "comments.txt": "# by hand\n\n1.5 2.25 -3 # first\n4 5e3 6.125\n#\n\n-7 8 9\n10 11 12\n# end\n",
    "bom.csv": "\ufeffx,y,z\n1.5,2.25,-3\n4,5e3,6.125\n-7,8,9\n10,11,12\n",
    "counted.pts": "4\n1.5 2.25 -3 100 1 2 3\n4 5e3 6.125 100 1 2 3\n-7 8 9 100 1 2 3\n10 11 12 100 1 2 3\n",
}


@pytest.mark.parametrize("size", [1, 3, 100])
@pytest.mark.parametrize("name", VARIANTS)
def test_text_variants(tmp_path: Path, name: str, size: int) -> None:
    path = tmp_path / name
    path.write_bytes(VARIANTS[name].encode())
    assert np.array_equal(points_of(open_cloud(path), size), POINTS)


@pytest.mark.parametrize("name", VARIANTS)
def test_ids_are_appended_to_the_lines(tmp_path: Path, name: str) -> None:
    path, out = tmp_path / name, tmp_path / f"labelled_{name}"
    path.write_bytes(VARIANTS[name].encode())
    assert write_labelled(open_cloud(path), out, Labels()) == 4
    if not name.endswith(".pts"):
        points, ids = next(read_labels(out))
        assert np.array_equal(points, POINTS)
        assert ids.tolist() == [-1, 9, 19, 29]
    assert write_labelled(open_cloud(path), out, Labels(missing=(1,)), overwrite=True) == 3


def test_text_lines_stay_as_they_were(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x;y;z;name\n1.50;2;3;\n4;5;6;\xe4\n", encoding="latin-1")
    write_labelled(open_cloud(tmp_path / "a.csv"), tmp_path / "b.csv", Labels())
    assert (tmp_path / "b.csv").read_text("latin-1") == "x;y;z;name;SegmentID\n1.50;2;3;;-1\n4;5;6;\xe4;9\n"


def test_labelling_text_again_replaces_the_ids(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z,SegmentID\n1,2,3,77\n4,5,6,78\n")
    write_labelled(open_cloud(tmp_path / "a.csv"), tmp_path / "b.csv", Labels())
    assert (tmp_path / "b.csv").read_text() == "x,y,z,SegmentID\n1,2,3,-1\n4,5,6,9\n"


def test_text_attributes(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(VARIANTS["reordered.csv"])
    cloud = open_cloud(tmp_path / "a.csv")
    assert cloud.point_count is None
    (chunk,) = cloud.chunks(attributes=["time"])
    assert chunk.attributes["time"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("header", ["a,b,c", "id,x,y", "lon,n,z", "x,y,intensity"])
def test_names_that_do_not_say_where_the_coordinates_are_are_refused(tmp_path: Path, header: str) -> None:
    (tmp_path / "a.csv").write_text(f"{header}\n1,2,3\n4,5,6\n")
    with pytest.raises(
        InvalidInput, match=f"names its columns {', '.join(header.split(','))}; which of them is .*name"
    ):
        open_cloud(tmp_path / "a.csv")


def test_a_line_that_is_no_point_is_named(tmp_path: Path) -> None:
    lines = ["# top", *(f"{i} 2 3" for i in range(1000))]
    lines[700] = "7 eight 9"
    (tmp_path / "a.xyz").write_text("\n".join(lines))
    with pytest.raises(InvalidInput, match=r"a\.xyz line 701: '7 eight 9' does not have numbers"):
        points_of(open_cloud(tmp_path / "a.xyz"), 64)


def test_a_last_line_that_is_cut_off_is_damage(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("".join(f"{i} 2 3\n" for i in range(1000)) + "7 8")
    cloud = open_cloud(tmp_path / "a.xyz")
    assert len(points_of(cloud, 64)) == 1000
    assert cloud.damage == "a.xyz is damaged in its last line ('7 8'); the 1,000 points before it were read"


def test_real_text_equals_what_numpy_reads(data: Path) -> None:
    path = data / "isprs" / "samp31.txt"
    whole = np.loadtxt(path)
    cloud = open_cloud(path)
    chunks = list(cloud.chunks(5000, ["column_4"]))
    assert np.array_equal(np.concatenate([chunk.points for chunk in chunks]), whole[:, :3])
    assert np.array_equal(np.concatenate([chunk.attributes["column_4"] for chunk in chunks]), whole[:, 3])


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_plain_points_become_las_1_4(tmp_path: Path, suffix: str) -> None:
    points = np.random.default_rng(5).random((1000, 3)) * 500 + [4e5, 5e6, 100]
    np.save(tmp_path / "a.npy", points)
    write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / f"b{suffix}", Labels())
    las = laspy.read(tmp_path / f"b{suffix}")
    assert (str(las.header.version), las.point_format.id) == ("1.4", 6)
    assert las.header.scales.tolist() == [0.001] * 3
    assert np.array_equal(las.header.offsets, np.floor(points.min(axis=0)))
    assert np.abs(las.xyz - points).max() <= 0.0005 + 1e-9
    assert np.array_equal(las["SegmentID"], np.arange(1000) * 10 - 1)
    assert set(np.array(las.return_number)) == set(np.array(las.number_of_returns)) == {1}


def test_a_cloud_too_wide_for_millimeters_gets_coarser_steps_and_a_warning(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0.0, 0, 0], [3e7, 1, 1]]))
    with pytest.warns(StreamsegWarning, match=r"30,000,000 units wide: LAS can hold it in steps of 0\.1, not"):
        write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.las", Labels())
    assert laspy.read(tmp_path / "b.las").x.max() == 3e7


def test_a_cloud_in_degrees_gets_finer_steps(tmp_path: Path) -> None:
    points = np.random.default_rng(6).random((100, 3)) * 0.1 + [8.4, 47.3, 0]
    np.save(tmp_path / "a.npy", points)
    write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.las", Labels())
    assert np.abs(laspy.read(tmp_path / "b.las").xyz - points).max() < 1e-7


def test_coordinates_that_are_no_numbers_are_refused_for_las(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0.0, 0, np.nan]]))
    with pytest.raises(InvalidInput, match="no point with finite coordinates"):
        write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.las", Labels())


def test_las_becomes_text_with_the_decimals_of_its_scale(data: Path, tmp_path: Path) -> None:
    path, out = data / "als" / "topography.laz", tmp_path / "b.csv"
    write_labelled(open_cloud(path), out, Labels())
    lines = out.read_text().splitlines()
    assert lines[0] == "x,y,z,SegmentID"
    assert [len(part.split(".")[1]) for part in lines[1].split(",")[:3]] == [5, 5, 5]
    points, ids = (np.concatenate(parts) for parts in zip(*read_labels(out), strict=True))
    assert np.allclose(points, laspy.read(path).xyz, rtol=0, atol=1e-9)
    assert np.array_equal(ids, np.arange(len(points)) * 10 - 1)


def test_npy_becomes_text_without_loss(tmp_path: Path) -> None:
    points = np.random.default_rng(7).random((50, 3)) * 1e6
    np.save(tmp_path / "a.npy", points)
    write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.xyz", Labels())
    assert np.array_equal(points_of(open_cloud(tmp_path / "b.xyz")), points)


def test_ids_alone_as_npy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((10, 3)))
    cloud = open_cloud(tmp_path / "a.npy")
    assert write_labelled(cloud, tmp_path / "b.npy", Labels()) == 10
    ids = np.load(tmp_path / "b.npy")
    assert ids.dtype == np.int64
    assert ids.tolist() == list(range(-1, 99, 10))
    assert write_labelled(cloud, tmp_path / "c.npy", Labels(missing=(0, 4, 8, 9))) == 6
    assert np.load(tmp_path / "c.npy").tolist() == [-1, 9, 19, 29, -1, 49, 59, 69]


def test_text_without_ids_is_refused_as_labelled(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z,n\n1,2,3,4\n")
    with pytest.raises(InvalidInput, match="has no column SegmentID; there are: x, y, z, n"):
        next(read_labels(tmp_path / "a.csv"))
    (tmp_path / "b.xyz").write_text("1 2 3 0.5\n")
    with pytest.raises(InvalidInput, match="not whole"):
        next(read_labels(tmp_path / "b.xyz"))
