"""What dimensions of LAS points mean where they are used: units, no data, names that are alike, normals."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

import streamseg as ss
from streamseg._core import meant_attribute
from streamseg.errors import InvalidInput, InvalidParameter, StreamsegWarning
from streamseg.io import open_cloud, read_labels

COUNT = 60


def write(path: Path, point_format: int = 1, extra: tuple[laspy.ExtraBytesParams, ...] = (), **values: Any) -> Path:
    """Write points in a row; values of dimensions are as they are stored."""
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 3 else "1.2")
    header.scales = np.full(3, 0.01)
    for params in extra:
        header.add_extra_dim(params)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.arange(COUNT) * 0.1, np.zeros(COUNT), np.zeros(COUNT)
    for name, value in values.items():
        las.points.array[name] = value
    las.write(path)
    return path


def kept_by(source: Any, text: str, **options: Any) -> list[int]:
    """List the points that pass a filter."""
    ids = ss.segment(source, ss.Proximity(100.0, graph="radius", filter=text), **options)
    return np.flatnonzero(ids >= 0).tolist()


@pytest.mark.parametrize("point_format", range(11))
@pytest.mark.parametrize("name", ["ScanAngle", "ScanAngleRank", "scan_angle", "scan_angle_rank"])
def test_the_scan_angle_is_in_degrees_under_both_names(tmp_path: Path, point_format: int, name: str) -> None:
    degrees = np.where(np.arange(COUNT) < 20, -6, 18)
    stored = {"scan_angle_rank": degrees} if point_format < 6 else {"scan_angle": degrees * 1000 // 6}
    path = write(tmp_path / "a.las", point_format, **stored)
    assert kept_by(path, f"{name} <= -6") == list(range(20))
    assert kept_by(path, f"{name} == 18") == list(range(20, COUNT))
    calculated = ss.PlaneExtraction(3.0, seed_calculator=f"{name} < 0 ? 1 : invalid", min_segment_size=3)
    assert ss.segment(path, calculated).shape == (COUNT,)
    criterion = ss.ConditionalClustering(f"abs({name} - n[0].{name}) < 1", search_radius=0.15, min_segment_size=1)
    assert len(np.unique(ss.segment(path, criterion))) == 2
    (chunk,) = open_cloud(path).chunks(attributes=("scan_angle", "scan_angle_rank"))
    assert np.array_equal(chunk.attributes["scan_angle"], degrees)
    assert np.array_equal(chunk.attributes["scan_angle_rank"], degrees)


def test_steps_of_the_scan_angle_are_rounded_once(tmp_path: Path) -> None:
    steps = np.arange(-30_000, 30_000, 1000)
    path = write(tmp_path / "a.las", 6, scan_angle=steps)
    (chunk,) = open_cloud(path).chunks(attributes=("scan_angle",))
    assert chunk.attributes["scan_angle"].tolist() == [step * 6 / 1000 for step in steps.tolist()]


def test_the_scan_angle_of_arrays_has_both_names() -> None:
    points, angles = np.zeros((4, 3)), np.arange(4.0)
    assert kept_by(points, "ScanAngle < 2", attributes={"scan_angle_rank": angles}) == [0, 1]
    assert kept_by(points, "ScanAngleRank < 2", attributes={"ScanAngle": angles}) == [0, 1]
    live = iter([(points, {"ScanAngle": angles})])
    assert kept_by(live, "ScanAngleRank < 2", attributes=["ScanAngle"]) == [0, 1]


def test_a_precise_scan_angle_of_its_own_is_the_one_that_is_meant(tmp_path: Path) -> None:
    extra = (laspy.ExtraBytesParams("ScanAngle", "f4"),)
    path = write(tmp_path / "a.las", 1, extra, scan_angle_rank=np.full(COUNT, 5), ScanAngle=np.arange(COUNT) / 10)
    assert kept_by(path, "ScanAngle < 1") == list(range(10))
    assert kept_by(path, "scan_angle < 1") == list(range(10))
    assert kept_by(path, "ScanAngleRank == 5") == list(range(COUNT))


@pytest.mark.parametrize(
    ("kind", "no_data", "stored"),
    [
        ("i2", -99, [-99, 5]),
        ("u1", 255, [255, 5]),
        ("u8", 2**64 - 1, [2**64 - 1, 5]),
        ("i8", -(2**63), [-(2**63), 5]),
        ("f4", -9999.9, [-9999.9, 5]),
        ("f8", 0.0, [0, 5]),
    ],
)
def test_no_data_is_invalid(tmp_path: Path, kind: str, no_data: float, stored: list[float]) -> None:
    values = np.resize(np.array(stored, kind), COUNT)
    path = write(tmp_path / "a.las", 6, (laspy.ExtraBytesParams("height", kind, no_data=[no_data]),), height=values)
    odd = list(range(1, COUNT, 2))
    assert kept_by(path, "valid(height)") == odd
    assert kept_by(path, "height < 6") == odd
    assert kept_by(path, "height > 6") == []


def test_no_data_beyond_the_type_means_no_value_at_all(tmp_path: Path) -> None:
    extra = (laspy.ExtraBytesParams("height", "u1", no_data=[-9999]),)
    path = write(tmp_path / "a.las", 6, extra, height=np.full(COUNT, -9999 % 256))
    assert kept_by(path, "valid(height)") == list(range(COUNT))


def test_scaled_dimensions_are_scaled_and_their_no_data_is_as_stored(tmp_path: Path) -> None:
    extra = (laspy.ExtraBytesParams("height", "i4", scales=[0.5], offsets=[100.0], no_data=[7]),)
    path = write(tmp_path / "a.las", 6, extra, height=np.arange(COUNT))
    (chunk,) = open_cloud(path).chunks(attributes=("height",))
    expected = np.arange(COUNT) * 0.5 + 100
    expected[7] = np.nan
    assert np.array_equal(chunk.attributes["height"], expected, equal_nan=True)
    assert kept_by(path, "height <= 104") == [0, 1, 2, 3, 4, 5, 6, 8]


def test_numbers_of_a_vector_have_names_of_their_own(tmp_path: Path) -> None:
    extra = (laspy.ExtraBytesParams("speed", "3f4", no_data=[1.0, 2.0, 3.0]),)
    path = write(tmp_path / "a.las", 6, extra, speed=np.arange(3 * COUNT).reshape(COUNT, 3))
    assert [name for name in open_cloud(path).dimensions if "speed" in name] == ["speed0", "speed1", "speed2"]
    assert kept_by(path, "speed1 < 6") == [0, 1]
    assert kept_by(path, "valid(speed2)") == list(range(COUNT))
    assert kept_by(path, "speed0 < 4") == [0, 1]


@pytest.mark.parametrize("name", ["Intensity", "INTENSITY", "inten_sity"])
def test_exact_spelling_wins_over_a_dimension_that_is_alike(tmp_path: Path, name: str) -> None:
    extra = (laspy.ExtraBytesParams(name, "i4"),)
    path = write(tmp_path / "a.las", 1, extra, intensity=np.full(COUNT, 7), **{name: np.arange(COUNT)})
    assert kept_by(path, "intensity == 7") == list(range(COUNT))
    assert kept_by(path, f"{name} == 7") == [7]
    with pytest.raises(InvalidParameter, match=rf"'inTensity' can be 'intensity' or '{name}'"):
        kept_by(path, "inTensity == 7")


def test_two_spellings_in_one_text_are_refused_where_they_are_two_dimensions(tmp_path: Path) -> None:
    extra = (laspy.ExtraBytesParams("Intensity", "i4"),)
    path = write(tmp_path / "a.las", 1, extra, Intensity=np.arange(COUNT))
    with pytest.raises(InvalidParameter, match="'Intensity' and 'intensity' are different attributes"):
        kept_by(path, "intensity < 3 and Intensity < 5")
    assert kept_by(path, "Z == 0 and z == 0 and X < 0.15") == [0, 1]


def test_a_dimension_called_z_is_not_the_height(tmp_path: Path) -> None:
    path = write(tmp_path / "a.las", 1, (laspy.ExtraBytesParams("zq", "i4"),), zq=np.arange(COUNT))
    path.write_bytes(path.read_bytes().replace(b"zq\0", b"z\0\0"))
    assert kept_by(path, "z < 3") == [0, 1, 2]
    assert kept_by(path, "Z == 0") == list(range(COUNT))


def test_columns_of_text_that_are_alike_are_told_apart_by_their_spelling(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,z,Height,height\n0,0,0,1,2\n0,0,0,2,1\n")
    assert kept_by(tmp_path / "a.csv", "Height == 1") == [0]
    assert kept_by(tmp_path / "a.csv", "height == 1") == [1]
    with pytest.raises(InvalidParameter, match="'HEIGHT' can be 'Height' or 'height'"):
        kept_by(tmp_path / "a.csv", "HEIGHT == 1")


NORMALS = (
    ("normal x", "normal y", "normal z"),
    ("NormalX", "NormalY", "NormalZ"),
    ("nx", "ny", "nz"),
    ("NX", "NY", "NZ"),
)


@pytest.mark.parametrize("names", NORMALS)
def test_normals_of_the_cloud_are_used_whatever_they_are_called(tmp_path: Path, names: tuple[str, str, str]) -> None:
    """Two halves of one plane, whose normals are said to differ."""
    points = np.column_stack([np.arange(COUNT) % 6, np.arange(COUNT) // 6, np.zeros(COUNT)]).astype(float)
    normals = np.where((points[:, 1] < 5)[:, None], [0.0, 0, 1], [1.0, 0, 0])
    grown = ss.RegionGrowing(k=5, min_segment_size=1)
    given = dict(zip(names, normals.T, strict=True))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        used = ss.segment(points, grown, attributes=given)
    assert len(np.unique(used)) > len(np.unique(ss.segment(points, grown)))
    header = laspy.LasHeader(point_format=6)
    header.add_extra_dims([laspy.ExtraBytesParams(name, "f4") for name in names])
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    for name, values in given.items():
        las[name] = values
    las.write(tmp_path / "a.las")
    assert np.array_equal(ss.segment(tmp_path / "a.las", grown), used)


@pytest.mark.parametrize("names", [("nx", "ny"), ("NormalX", "ny", "nz"), ("normal[0]", "normal[1]", "normal[2]")])
def test_normals_that_are_not_used_are_told(names: tuple[str, ...]) -> None:
    points = np.random.default_rng(1).random((COUNT, 3))
    given = {name: np.ones(COUNT) for name in names}
    with pytest.warns(StreamsegWarning, match="NormalX, NormalY, NormalZ are computed, though the cloud has"):
        found = ss.segment(points, ss.RegionGrowing(k=5, min_segment_size=1), attributes=given)
    assert np.array_equal(found, ss.segment(points, ss.RegionGrowing(k=5, min_segment_size=1)))


def test_names_are_looked_up_alike_in_python() -> None:
    assert meant_attribute("ScanAngle", ["scan_angle_rank", "nir"]) == "scan_angle_rank"
    assert meant_attribute("Infrared", ["nir"]) == "nir"
    assert meant_attribute("height", ["x"]) is None
    with pytest.raises(InvalidInput, match="'a' or 'A'"):
        meant_attribute("_a", ["a", "A"])


def test_files_that_count_time_from_different_days_are_told(tmp_path: Path) -> None:
    paths = [write(tmp_path / f"{name}.las", 1, gps_time=np.arange(COUNT)) for name in "ab"]
    raw = bytearray(paths[1].read_bytes())
    raw[6] |= 1
    paths[1].write_bytes(raw)
    with pytest.warns(StreamsegWarning, match=r"a\.las is seconds of the GPS week, that of .*b\.las is GPS time less"):
        open_cloud(paths)


def test_ids_that_are_no_data_are_none(tmp_path: Path) -> None:
    extra = (laspy.ExtraBytesParams("treeID", "i4", no_data=[-(2**31)]),)
    path = write(tmp_path / "a.las", 1, extra, treeID=np.where(np.arange(COUNT) < 5, -(2**31), 3))
    ((_, ids),) = read_labels(path, id_name="treeID")
    assert ids.tolist() == [-1] * 5 + [3] * (COUNT - 5)
