"""LAS and LAZ: chunks equal the whole, and what is written keeps everything that was read."""

from __future__ import annotations

import struct
import warnings
from typing import TYPE_CHECKING, Any

import laspy
import numpy as np
import pytest

from streamseg.errors import FileError, InvalidInput, InvalidParameter, StreamsegWarning
from streamseg.io import open_cloud, read_labels, write_labelled

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

KEPT_FIELDS = (
    "version",
    "scales",
    "offsets",
    "system_identifier",
    "generating_software",
    "uuid",
    "file_source_id",
    "extra_header_bytes",
    "extra_vlr_bytes",
)


class Labels:
    """Ids that differ from point to point; the points in `missing` are not reached."""

    def __init__(self, missing: range = range(0), factor: int = 7) -> None:
        self.missing, self.factor = missing, factor

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        points = np.arange(start, stop)
        return points * self.factor % 1001 - 1, ~np.isin(points, self.missing)


def ids_of(count: int, factor: int = 7) -> NDArray[np.int64]:
    return np.arange(count) * factor % 1001 - 1


def write_las(path: Path, count: int = 1000, point_format: int = 6, seed: int = 1, **header_fields: Any) -> Path:
    """Write random points with every dimension filled, an extra dimension and a record nobody knows."""
    random = np.random.default_rng(seed)
    header = laspy.LasHeader(point_format=point_format)
    header.scales, header.offsets = np.array([0.01, 0.01, 0.001]), np.array([5e5, 5.4e6, -10.0])
    for name, value in header_fields.items():
        setattr(header, name, value)
    header.add_extra_dim(laspy.ExtraBytesParams("quality", "f4", "a user's own", no_data=[-9.0]))
    header.vlrs.append(laspy.VLR("somebody", 77, "kept as it is", bytes(range(50))))
    las = laspy.LasData(header)
    records = np.zeros(count, header.point_format.dtype())
    raw = random.integers(0, 256, records.nbytes, dtype=np.uint8)
    records = raw.view(records.dtype)
    for axis in "XYZ":
        records[axis] = random.integers(-100_000, 100_000, count)
    if "gps_time" in (records.dtype.names or ()):
        records["gps_time"] = np.sort(random.random(count))
    records["quality"] = random.random(count)
    las.points = laspy.ScaleAwarePointRecord(records, header.point_format, header.scales, header.offsets)
    las.write(str(path))
    return path


def raw_steps(path: Path) -> NDArray[np.float64]:
    points = laspy.read(path).points
    return np.column_stack([points[axis] for axis in "XYZ"]).astype(np.float64)


def records_of(header: laspy.LasHeader) -> list[tuple[str, int, str, bytes]]:
    """All records but the two that have to change."""
    return [
        (vlr.user_id, vlr.record_id, vlr.description, vlr.record_data_bytes())
        for vlr in header.vlrs
        if "laszip" not in vlr.user_id and (vlr.user_id, vlr.record_id) != ("LASF_Spec", 4)
    ]


def assert_kept(before: Path, after: Path) -> laspy.LasData:
    old, new = laspy.read(before), laspy.read(after)
    assert len(new) == len(old)
    for name in old.point_format.dimension_names:
        if name != "SegmentID":
            assert np.array_equal(np.array(new.points[name]), np.array(old.points[name])), name
    for field in KEPT_FIELDS:
        assert np.all(getattr(new.header, field) == getattr(old.header, field)), field
    if old.header.creation_date is not None:  # laspy dates what has no date
        assert new.header.creation_date == old.header.creation_date
    assert new.header.global_encoding.value == old.header.global_encoding.value
    assert new.point_format.id == old.point_format.id
    assert records_of(new.header) == records_of(old.header)
    return new


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("size", [1, 7, 50_000, 10**9])
def test_chunks_equal_the_whole(tmp_path: Path, suffix: str, size: int) -> None:
    path = write_las(tmp_path / f"a.{suffix}")
    chunks = list(open_cloud(path).chunks(size))
    assert [len(chunk.points) for chunk in chunks[:-1]] == [size] * (len(chunks) - 1)
    assert all(chunk.points.flags.c_contiguous and chunk.points.dtype == np.float64 for chunk in chunks)
    assert np.array_equal(np.concatenate([chunk.points for chunk in chunks]), raw_steps(path))


@pytest.mark.parametrize("size", [7777, 50_000, 10**9])
def test_chunks_of_a_large_file_equal_the_whole(data: Path, size: int) -> None:
    path = data / "isprs" / "CSite3.laz"
    cloud = open_cloud(path)
    assert cloud.point_count == 377_028
    assert cloud.damage is None
    points = np.concatenate([chunk.points for chunk in cloud.chunks(size)])
    assert np.array_equal(points, raw_steps(path))


@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
@pytest.mark.parametrize("suffixes", [("las", "laz"), ("laz", "las")])
def test_writing_keeps_every_dimension(tmp_path: Path, point_format: int, suffixes: tuple[str, str]) -> None:
    before, after = write_las(tmp_path / f"a.{suffixes[0]}", 3000, point_format), tmp_path / f"b.{suffixes[1]}"
    assert write_labelled(open_cloud(before), after, Labels()) == 3000
    assert_kept(before, after)
    new = laspy.read(after)
    assert np.array_equal(new["SegmentID"], ids_of(3000))
    assert new["SegmentID"].dtype == np.int32
    assert new.header.are_points_compressed == (suffixes[1] == "laz")
    assert new.point_format.dimension_by_name("quality").description == "a user's own"
    assert np.allclose(new.header.mins, laspy.read(before).header.mins)
    assert np.allclose(new.header.maxs, laspy.read(before).header.maxs)
    assert np.array_equal(new.header.number_of_points_by_return, laspy.read(before).header.number_of_points_by_return)


def test_writing_keeps_every_file_of_the_collection(data: Path, tmp_path: Path) -> None:
    files = sorted(path for path in data.glob("*/*.laz") if path.parent.name != "odd")  # laspy cannot read these
    assert len(files) >= 20
    for before in files:
        after = tmp_path / "after.laz"
        count = write_labelled(open_cloud(before), after, Labels(), overwrite=True)
        new = assert_kept(before, after)
        assert np.array_equal(new["SegmentID"], ids_of(count)), before


def test_labelling_again_replaces_the_ids(tmp_path: Path) -> None:
    before, once, twice = write_las(tmp_path / "a.laz"), tmp_path / "b.laz", tmp_path / "c.laz"
    write_labelled(open_cloud(before), once, Labels())
    write_labelled(open_cloud(once), twice, Labels(factor=11))
    new = laspy.read(twice)
    assert list(new.point_format.extra_dimension_names) == ["quality", "SegmentID"]
    assert np.array_equal(new["SegmentID"], ids_of(1000, 11))
    assert_kept(before, twice)


def test_a_segment_dimension_of_another_type_makes_way(tmp_path: Path) -> None:
    path = tmp_path / "a.las"
    header = laspy.LasHeader(point_format=1)
    header.add_extra_dims([laspy.ExtraBytesParams("SegmentID", "u2"), laspy.ExtraBytesParams("tail", "u1")])
    las = laspy.LasData(header)
    las.X = np.arange(10)
    las["SegmentID"], las["tail"] = np.arange(10), np.arange(10)[::-1].copy()
    las.write(str(path))
    write_labelled(open_cloud(path), tmp_path / "b.las", Labels(factor=200))
    new = laspy.read(tmp_path / "b.las")
    assert new["SegmentID"].dtype == np.int32
    assert np.array_equal(new["SegmentID"], ids_of(10, 200))
    assert np.array_equal(new["tail"], np.arange(10)[::-1])


@pytest.mark.parametrize("count", [1, 3, 8, 300])
def test_undescribed_extra_bytes_are_kept(tmp_path: Path, count: int) -> None:
    """Even more than the 255 that a description can speak of."""
    path, stored = tmp_path / "a.las", np.random.default_rng(8).integers(0, 256, (20, count), np.uint8).squeeze()
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.add_extra_dim(laspy.ExtraBytesParams("mine", f"{count}u1"))
    las = laspy.LasData(header)
    las.X = np.arange(20)
    las.points.array["mine"] = stored
    las.write(str(path))
    raw = bytearray(path.read_bytes())
    raw[227 + 2 : 227 + 18] = b"nobody".ljust(16, b"\0")  # hides the record that describes them
    path.write_bytes(raw)
    assert list(laspy.read(path).point_format.extra_dimension_names) == ["ExtraBytes"]
    write_labelled(open_cloud(path), tmp_path / "b.las", Labels())
    new = laspy.read(tmp_path / "b.las")
    assert np.array_equal(new.points.array["ExtraBytes"], stored)
    assert np.array_equal(new["SegmentID"], ids_of(20))


def test_extended_records_are_kept_and_those_of_copc_dropped(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz")
    las = laspy.read(path)
    las.evlrs = laspy.vlrs.vlrlist.VLRList(
        [laspy.VLR("copc", 1000, "octree", b"x" * 40), laspy.VLR("somebody", 3, "long", b"payload" * 20_000)]
    )
    las.write(str(path))
    write_labelled(open_cloud(path), tmp_path / "b.laz", Labels())
    kept = laspy.read(tmp_path / "b.laz").evlrs
    assert [(evlr.user_id, evlr.record_id, evlr.record_data_bytes()) for evlr in kept] == [
        ("somebody", 3, b"payload" * 20_000)
    ]


def test_payloads_are_kept_byte_by_byte(tmp_path: Path) -> None:
    """Also those that laspy understands and would write in its own way."""
    lookup, keys = b"\x02gr\xfbn-d".ljust(16, b"\0") * 2, struct.pack("<12H", 1, 1, 0, 9, *[3072, 0, 1, 26904] * 2)
    vlrs = [laspy.VLR("LASF_Spec", 0, "classes", lookup), laspy.VLR("LASF_Projection", 34735, "keys", keys)]
    before = write_las(tmp_path / "a.las")
    las = laspy.read(before)
    las.vlrs.extend(vlrs)
    las.write(before)
    write_labelled(open_cloud(before), tmp_path / "b.laz", Labels())
    for vlr in vlrs:
        assert vlr.record_data in before.read_bytes()
        assert vlr.record_data in (tmp_path / "b.laz").read_bytes()


def test_descriptions_of_extra_dimensions_are_kept(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6)
    header.add_extra_dim(laspy.ExtraBytesParams("plain", "i2", "in cm", no_data=[-7]))
    header.add_extra_dim(
        laspy.ExtraBytesParams("scaled", "3i4", "three", offsets=[0.1, 0.2, 0.3], scales=[0.001, 0.003, 0.007])
    )
    las = laspy.LasData(header)
    las.X = np.arange(1000)
    stored = np.random.default_rng(5).integers(-(2**31), 2**31, (1000, 3), np.int32)
    las.points.array["scaled"] = stored
    las.write(tmp_path / "a.las")
    write_labelled(open_cloud(tmp_path / "a.las"), tmp_path / "b.laz", Labels())
    new = laspy.read(tmp_path / "b.laz")
    assert np.array_equal(new.points.array["scaled"], stored)
    plain, scaled, segment = new.header.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs
    assert (plain.description, plain.no_data.tolist()) == (b"in cm", [-7])
    assert (list(scaled.scale), list(scaled.offset)) == ([0.001, 0.003, 0.007], [0.1, 0.2, 0.3])
    assert (segment.name, segment.min, segment.max, segment.no_data) == (b"SegmentID", None, None, None)


@pytest.mark.parametrize("minor", [3, 4])
def test_waveforms_are_kept_and_found(tmp_path: Path, minor: int) -> None:
    header, path = laspy.LasHeader(version=f"1.{minor}", point_format=4), tmp_path / "a.las"
    header.global_encoding.waveform_data_packets_internal = True
    las = laspy.LasData(header)
    las.X = np.arange(10)
    las.write(path)
    raw, waves = bytearray(path.read_bytes()), bytes(range(256)) * 300
    struct.pack_into("<Q", raw, 227, len(raw))
    if minor == 4:
        struct.pack_into("<QI", raw, 235, len(raw), 1)
    raw += struct.pack("<2x16sHQ32s", b"LASF_Spec", 65535, len(waves), b"waves") + waves
    path.write_bytes(raw)
    write_labelled(open_cloud(path), tmp_path / "b.las", Labels())
    written = (tmp_path / "b.las").read_bytes()
    (at,) = struct.unpack_from("<Q", written, 227)
    assert struct.unpack_from("<2x16sHQ", written, at) == (b"LASF_Spec".ljust(16, b"\0"), 65535, len(waves))
    assert written[at + 60 :] == waves
    assert np.array_equal(laspy.read(tmp_path / "b.las")["SegmentID"], ids_of(10))


def test_points_that_were_not_reached_are_left_out(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz")
    assert write_labelled(open_cloud(path), tmp_path / "b.laz", Labels(missing=range(100, 900))) == 200
    new, kept = laspy.read(tmp_path / "b.laz"), np.r_[0:100, 900:1000]
    assert new.header.point_count == 200
    assert np.array_equal(raw_steps(tmp_path / "b.laz"), raw_steps(path)[kept])
    assert np.array_equal(new["SegmentID"], ids_of(1000)[kept])


def test_attributes_are_what_laspy_reads(data: Path) -> None:
    path = data / "als" / "lidarhd_77050_627755.laz"
    names = ("gps_time", "scan_direction_flag", "edge_of_flight_line", "classification", "red", "nir", "intensity")
    las = laspy.read(path)
    for name in names:  # one by one, so that each is decoded on its own
        parts = [chunk.attributes[name] for chunk in open_cloud(path).chunks(20_000, (name,))]
        assert np.array_equal(np.concatenate(parts), np.array(las[name])), name
    (whole,) = open_cloud(path).chunks(10**6, names)
    assert list(whole.attributes) == list(names)
    assert np.array_equal(whole.points, raw_steps(path))


def test_a_missing_attribute_is_refused_with_the_list_of_those_there(data: Path) -> None:
    cloud = open_cloud(data / "isprs" / "CSite3.laz")
    with pytest.raises(InvalidInput, match=r"no dimension 'gps_time'; there are: X, Y, Z, intensity"):
        cloud.chunks(attributes=("gps_time",))


def test_a_chunk_size_below_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="chunk size is 0"):
        open_cloud(write_las(tmp_path / "a.las")).chunks(0)


def test_several_files_are_one_stream(tmp_path: Path) -> None:
    paths = [write_las(tmp_path / f"{i}.laz", 500 + i, seed=i) for i in range(3)]
    cloud = open_cloud(paths)
    assert cloud.paths == tuple(paths)
    assert cloud.point_count == 1503
    expected = np.concatenate([raw_steps(path) for path in paths])
    assert np.array_equal(np.concatenate([chunk.points for chunk in cloud.chunks(100)]), expected)
    write_labelled(cloud, tmp_path / "all.laz", Labels())
    assert np.array_equal(raw_steps(tmp_path / "all.laz"), expected)
    assert np.array_equal(laspy.read(tmp_path / "all.laz")["SegmentID"], ids_of(1503))


def test_files_on_shifted_lattices_come_onto_the_first_exactly(tmp_path: Path) -> None:
    one = write_las(tmp_path / "a.las")
    two = write_las(tmp_path / "b.las", seed=2, offsets=np.array([500_123.45, 5.4e6, -11.0]))
    cloud = open_cloud([one, two])
    assert cloud.lattice == ((0.01, 0.01, 0.001), (5e5, 5.4e6, -10.0))
    points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert np.array_equal(points[:1000], raw_steps(one))
    assert np.array_equal(points[1000:], raw_steps(two) + np.array([12_345, 0, -1000]))
    write_labelled(cloud, tmp_path / "c.las", Labels())
    assert np.array_equal(raw_steps(tmp_path / "c.las"), points)


def test_a_file_with_finer_steps_refines_the_common_lattice(tmp_path: Path) -> None:
    one = write_las(tmp_path / "a.las")
    two = write_las(tmp_path / "b.las", seed=2, scales=np.array([0.001, 0.01, 0.001]))
    cloud = open_cloud([one, two])
    assert cloud.lattice.scale == (0.001, 0.01, 0.001)
    points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert np.array_equal(points, np.concatenate([raw_steps(one) * [10, 1, 1], raw_steps(two)]))
    write_labelled(cloud, tmp_path / "c.las", Labels())
    written = laspy.read(tmp_path / "c.las").xyz
    assert np.allclose(written, np.concatenate([laspy.read(one).xyz, laspy.read(two).xyz]), rtol=0, atol=1e-6)


def test_formats_of_one_family_are_written_as_the_one_that_holds_both(tmp_path: Path) -> None:
    one, two = write_las(tmp_path / "a.las", point_format=1), write_las(tmp_path / "b.las", point_format=2, seed=2)
    write_labelled(open_cloud([one, two]), tmp_path / "c.las", Labels())
    new = laspy.read(tmp_path / "c.las")
    assert new.point_format.id == 3
    assert np.array_equal(new["gps_time"], np.r_[np.array(laspy.read(one)["gps_time"]), np.zeros(1000)])
    assert np.array_equal(new["red"], np.r_[np.zeros(1000), np.array(laspy.read(two)["red"])])
    assert np.array_equal(new["quality"][1000:], laspy.read(two)["quality"])


def test_formats_of_two_families_are_refused(tmp_path: Path) -> None:
    cloud = open_cloud([write_las(tmp_path / "a.las", point_format=1), write_las(tmp_path / "b.las", point_format=6)])
    with pytest.raises(InvalidInput, match=r"a\.las has 1, b\.las has 6"):
        write_labelled(cloud, tmp_path / "c.las", Labels())
    assert not (tmp_path / "c.las").exists()


@pytest.mark.parametrize(
    "other",
    [
        laspy.ExtraBytesParams("mine", "u4"),
        laspy.ExtraBytesParams("mine", "4u1"),
        laspy.ExtraBytesParams("mine", "i4", scales=[0.1], offsets=[0.0]),
    ],
)
def test_dimensions_of_one_name_and_two_meanings_are_refused(tmp_path: Path, other: laspy.ExtraBytesParams) -> None:
    for name, params in (("a.las", laspy.ExtraBytesParams("mine", "i4")), ("b.las", other)):
        header = laspy.LasHeader(point_format=6)
        header.add_extra_dim(params)
        las = laspy.LasData(header)
        las.X = np.arange(10)
        las.write(tmp_path / name)
    with pytest.raises(InvalidInput, match=r"dimension 'mine' of b\.las has another type, scale or offset"):
        write_labelled(open_cloud([tmp_path / "a.las", tmp_path / "b.las"]), tmp_path / "c.las", Labels())


def test_mixed_kinds_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "b.npy", np.zeros((3, 3)))
    with pytest.raises(InvalidInput, match=r"a\.las is las, b\.npy is npy"):
        open_cloud([write_las(tmp_path / "a.las"), tmp_path / "b.npy"])


def test_points_beyond_32_bits_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    one = write_las(tmp_path / "a.las")
    two = write_las(tmp_path / "b.las", seed=2, offsets=np.array([9e7, 5.4e6, -10.0]))
    with pytest.raises(InvalidInput, match=r"b\.las has points too far away for 32 bit"):
        write_labelled(open_cloud([one, two]), tmp_path / "c.las", Labels())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.las", "b.las"]


def test_labels_are_read_back_with_coordinates(tmp_path: Path) -> None:
    path = write_las(tmp_path / "a.laz")
    write_labelled(open_cloud(path), tmp_path / "b.laz", Labels())
    points, ids = (np.concatenate(parts) for parts in zip(*read_labels(tmp_path / "b.laz", 300), strict=True))
    assert np.allclose(points, laspy.read(path).xyz, rtol=0, atol=1e-9)
    assert np.array_equal(ids, ids_of(1000))
    with pytest.raises(InvalidInput, match="no dimension 'SegmentID'; there are: X, Y, Z"):
        next(read_labels(path))


def test_one_coordinate_is_scale_times_step_plus_offset(tmp_path: Path) -> None:
    cloud = open_cloud(write_las(tmp_path / "a.las"))
    (chunk,) = cloud.chunks()
    assert np.allclose(cloud.lattice.to_coordinates(chunk.points), laspy.read(cloud.paths[0]).xyz, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (0, b"LAZ!", "is no LAS or LAZ file"),
        (24, b"\x02", r"is LAS version 2\.4; versions 1\.0 to 1\.5"),
        (94, struct.pack("<H", 9), "its size is given as 9 bytes"),
        (100, struct.pack("<I", 2**32 - 1), "record 3 of 4,294,967,295 reaches into the points"),
        (104, b"\x0b", "has point format 11; formats 0 to 10"),
        (105, struct.pack("<H", 5), "damaged header"),
        (131, struct.pack("<d", 0.0), "scale"),
    ],
)
def test_a_damaged_header_is_told(tmp_path: Path, at: int, value: bytes, said: str) -> None:
    path = write_las(tmp_path / "a.las")
    raw = bytearray(path.read_bytes())
    raw[at : at + len(value)] = value
    path.write_bytes(raw)
    with pytest.raises(FileError, match=said):
        open_cloud(path)


def test_the_unit_is_known_where_the_file_says_it(data: Path) -> None:
    assert open_cloud(data / "als" / "autzen_trim.laz").unit == "ft"
    assert open_cloud(data / "als" / "hawaii_pass.laz").unit == "m"
    assert open_cloud(data / "als" / "delft_ahn3.laz").unit is None


def test_files_of_different_coordinate_systems_and_files_given_twice_are_warned_of(tmp_path: Path) -> None:
    def write(name: str, wkt: str | None) -> Path:
        header = laspy.LasHeader(version="1.4", point_format=6)
        if wkt is not None:
            header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
        cloud = laspy.LasData(header)
        cloud.x = cloud.y = cloud.z = np.arange(3.0)
        cloud.write(str(tmp_path / name))
        return tmp_path / name

    utm = write("utm.las", 'PROJCS["UTM 32", UNIT["metre", 1]]')
    same = write("same.las", 'PROJCS["UTM 32",UNIT["metre",1]]')
    other = write("other.las", 'PROJCS["UTM 33",UNIT["metre",1]]')
    silent = write("silent.las", None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        open_cloud([utm, same])
    with pytest.warns(StreamsegWarning, match=r"silent\.las names no coordinate system; that of .*utm\.las is taken"):
        open_cloud([silent, utm, same])
    with pytest.warns(StreamsegWarning, match=r"utm\.las and .*other\.las have different coordinate systems"):
        open_cloud([utm, same, other])
    with pytest.warns(StreamsegWarning, match=r"utm\.las is given more than once"):
        open_cloud([utm, same, utm])
