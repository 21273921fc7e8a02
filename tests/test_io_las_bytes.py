"""What is written of a LAS file is, byte by byte, what was read; and LASzip itself can read it."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import lazrs
import numpy as np
import pytest
from numpy.typing import NDArray

from streamseg.errors import FileError, InvalidInput, StreamsegWarning
from streamseg.io import LabelSpool, check_kind, open_cloud, write_labelled

FORMATS = [
    (0, 2),
    (1, 2),
    (2, 2),
    (3, 2),
    (4, 3),
    (5, 3),
    (0, 4),
    (3, 4),
    (5, 4),
    *((i, 4) for i in range(6, 11)),
    (6, 5),
]
WAVEFORMS = {4, 5, 9, 10}
ENCODING, SYSTEM, SOFTWARE, DATE = 6, 26, 58, 90
OFFSET_TO_POINTS, LEGACY, BOX = 96, 107, 179
POINTS = 300

# Names and texts that fill their fields, are no ASCII, or go on behind their end.
FULL_USER, FULL_ABOUT = b"sixteen_letters!", b"a description of thirty-two byte"
ODD_USER, ODD_ABOUT = "münch".encode("latin-1").ljust(16, b"\0"), b"caf\xe9\0behind".ljust(32, b"\0")


class Record(NamedTuple):
    reserved: bytes
    user: bytes
    number: int
    about: bytes
    data: bytes


class Raw(NamedTuple):
    """A file taken apart by the specification, without laspy."""

    header: bytes
    vlrs: list[Record]
    padding: bytes
    evlrs: list[Record]
    evlrs_at: int


def take_apart(path: Path) -> Raw:
    data = path.read_bytes()
    size, points_at, count = struct.unpack_from("<HII", data, 94)
    vlrs, at = records(data, size, count, struct.Struct("<2s16sHH32s"))
    first, extended = struct.unpack_from("<QI", data, 235) if data[25] >= 4 else (0, 0)
    if data[25] == 3 and (first := struct.unpack_from("<Q", data, 227)[0]):
        extended = 1
    evlrs, _ = records(data, first, extended, struct.Struct("<2s16sHQ32s"))
    return Raw(data[:size], vlrs, data[at:points_at], evlrs, first)


def records(data: bytes, at: int, count: int, layout: struct.Struct) -> tuple[list[Record], int]:
    found = []
    for _ in range(count):
        reserved, user, number, length, about = layout.unpack_from(data, at)
        at += layout.size + length
        found.append(Record(reserved, user, number, about, data[at - length : at]))
    return found, at


class Labels:
    largest_id = POINTS

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return np.arange(start, stop), np.ones(stop - start, np.bool_)


def write_odd(path: Path, point_format: int, minor: int, is_one_channel: bool = False) -> None:
    """Write a file in which every field of the header, every record and every dimension has something to lose.

    Waveforms can be of one scanner channel.
    """
    rng = np.random.default_rng(point_format)
    header = laspy.LasHeader(version=f"1.{minor}", point_format=point_format)
    header.scales, header.offsets = np.array([0.01, 0.01, 0.001]), np.array([5e5, 5.4e6, -10.0])
    header.add_extra_dim(laspy.ExtraBytesParams("quality", "i2", "with no data", no_data=[-9]))
    header.add_extra_dim(laspy.ExtraBytesParams("vector", "3f4", "three"))
    header.vlrs.append(laspy.VLR("A" * 15, 7, "B" * 31, bytes(range(60))))
    header.vlrs.append(laspy.VLR("C" * 15, 8, "D" * 31, b"odd"))
    header.extra_header_bytes, header.extra_vlr_bytes = b"user bytes", b"\xdd\xcc and more"
    las = laspy.LasData(header)
    records = rng.integers(0, 256, POINTS * header.point_format.size, dtype=np.uint8).view(header.point_format.dtype())
    for axis in "XYZ":
        records[axis] = rng.integers(-100_000, 100_000, POINTS)
    for name in records.dtype.names or ():
        if records.dtype[name].base.kind == "f":
            records[name] = rng.random(records[name].shape)
    if is_one_channel and point_format in (9, 10):
        records["classification_flags"] |= 0b11_0000
    las.points = laspy.ScaleAwarePointRecord(records, header.point_format, header.scales, header.offsets)
    las.write(path)
    raw = bytearray(path.read_bytes())
    struct.pack_into("<H", raw, 4, 4711)
    raw[ENCODING : ENCODING + 2] = struct.pack("<H", 0b1010_0000_0000_1001 | (0b1_0000 if point_format > 5 else 0))
    raw[8:24] = rng.integers(0, 256, 16, dtype=np.uint8).tobytes()
    raw[SYSTEM : SYSTEM + 32] = "Zürich".encode("latin-1").ljust(10, b"\0") + b"behind".ljust(22, b"\xff")
    raw[SOFTWARE : SOFTWARE + 32] = b"software of just thirty-two byte"
    raw[DATE : DATE + 4] = struct.pack("<HH", 400, 0)
    for name, (user, about) in {b"A": (FULL_USER, FULL_ABOUT), b"C": (ODD_USER, ODD_ABOUT)}.items():
        at = raw.index(name * 15)
        raw[at - 2 : at] = b"\xbb\xaa"
        raw[at : at + 16] = user
        raw[at + 20 : at + 52] = about
    if minor >= 4:
        struct.pack_into("<QI", raw, 235, len(raw), 2)
    evlrs = []
    if minor >= 4:
        evlrs.append(Record(b"\1\2", FULL_USER, 99, FULL_ABOUT, bytes(70_000)))
    if minor >= 4 or (point_format in WAVEFORMS and minor == 3):
        evlrs.append(
            Record(b"\0\0", b"LASF_Spec".ljust(16, b"\0"), 65535, b"waves".ljust(32, b"\0"), bytes(range(200)))
        )
    for record in evlrs:
        if record.number == 65535:
            struct.pack_into("<Q", raw, 227, len(raw))
            raw[ENCODING] |= 0b10
        raw += struct.pack("<2s16sHQ32s", *record[:3], len(record.data), record.about) + record.data
    path.write_bytes(raw)


def dimensions(path: Path, backend: Any = None) -> dict[str, NDArray[Any]]:
    points = laspy.read(path, **({} if backend is None else {"laz_backend": backend})).points
    return {name: np.array(points[name]) for name in points.point_format.dimension_names}


@pytest.mark.parametrize(("point_format", "minor"), FORMATS)
@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_header_records_and_dimensions_are_as_they_were(
    tmp_path: Path, point_format: int, minor: int, suffix: str
) -> None:
    before, after = tmp_path / "before.las", tmp_path / f"after{suffix}"
    write_odd(before, point_format, minor, is_one_channel=suffix == ".laz")
    # laspy does not read identifiers that are no UTF-8, so what it reads for comparison is made legible.
    legible = tmp_path / "legible.las"
    legible.write_bytes(before.read_bytes().replace(ODD_USER, b"munch".ljust(16, b"\0")))
    write_labelled(open_cloud(before), after, Labels())
    old, new = take_apart(before), take_apart(after)

    assert len(new.header) == len(old.header)
    changing = {*range(94, 107), *range(227, 247 if minor >= 4 else 235)}
    if minor >= 4:  # laspy fills the counts of older versions with zeros, also where they have to be given
        changing |= set(range(LEGACY, 131))
        legacy = struct.unpack_from("<6I", new.header, LEGACY)
        counts = struct.unpack_from("<6Q", new.header, 247)
        assert legacy == (counts if point_format < 6 else (0,) * 6)
    if point_format not in WAVEFORMS and minor < 3:
        changing -= set(range(227, 235))
    kept = [at for at in range(len(old.header)) if at not in changing]
    assert bytes(new.header[at] for at in kept) == bytes(old.header[at] for at in kept)
    assert new.padding == old.padding
    assert new.evlrs == old.evlrs

    described = ("LASF_Spec", 4)
    ours = [record for record in new.vlrs if not record.user.startswith(b"laszip")]
    keys = [(record.user.split(b"\0")[0].decode("latin-1"), record.number) for record in ours]
    assert [record for record, key in zip(ours, keys, strict=True) if key != described] == [
        record for record in old.vlrs if not record.user.startswith(b"LASF_Spec")
    ]
    (dims_before,) = (record.data for record in old.vlrs if record.user.startswith(b"LASF_Spec"))
    (dims_after,) = (record.data for record, key in zip(ours, keys, strict=True) if key == described)
    assert dims_after[: 192 * 2] == dims_before
    assert len(dims_after) == 192 * 3

    after_legible = tmp_path / f"after_legible{suffix}"
    after_legible.write_bytes(after.read_bytes().replace(ODD_USER, b"munch".ljust(16, b"\0")))
    values, written = dimensions(legible), dimensions(after_legible)
    assert list(written) == [*values, "SegmentID"]
    for name, value in values.items():
        assert np.array_equal(written[name], value), name
    if any(record.number == 65535 for record in new.evlrs):
        (at,) = struct.unpack_from("<Q", new.header, 227)
        assert after.read_bytes()[at + 2 : at + 11] == b"LASF_Spec"


@pytest.mark.parametrize("point_format", range(11))
def test_laszip_reads_every_point_format(tmp_path: Path, point_format: int) -> None:
    before, after = tmp_path / "before.las", tmp_path / "after.laz"
    write_odd(before, point_format, 4 if point_format > 5 else 3, is_one_channel=True)
    before.write_bytes(before.read_bytes().replace(ODD_USER, b"munch".ljust(16, b"\0")))
    write_labelled(open_cloud(before), after, Labels())
    values, read = dimensions(before), dimensions(after, laspy.LazBackend.Laszip)
    assert np.array_equal(read.pop("SegmentID"), np.arange(POINTS))
    assert list(read) == list(values)
    for name, value in values.items():
        assert np.array_equal(read[name], value), name
    # What is read again by ourselves is the same.
    again = tmp_path / "again.las"
    write_labelled(open_cloud(after), again, Labels())
    for name, value in dimensions(again).items():
        assert np.array_equal(value, values.get(name, np.arange(POINTS))), name


def test_laszip_reads_what_was_no_las(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.random.default_rng(3).random((50, 3)))
    write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.laz", Labels())
    read = laspy.read(tmp_path / "b.laz", laz_backend=laspy.LazBackend.Laszip)
    assert np.array_equal(read["SegmentID"], np.arange(50))
    assert set(np.array(read.return_number)) == set(np.array(read.number_of_returns)) == {1}


def test_names_of_extra_dimensions_are_kept_and_can_all_be_reached(tmp_path: Path) -> None:
    """Also where they are Latin-1, or the names of standard dimensions."""
    header = laspy.LasHeader(version="1.2", point_format=1)
    for name in ("hxhe", "intensitz", "classificatiom", "zq"):
        header.add_extra_dim(laspy.ExtraBytesParams(name, "i4"))
    las = laspy.LasData(header)
    las.X = np.arange(10)
    las.intensity, las.classification = np.full(10, 7), np.full(10, 2)
    for number, name in enumerate(("hxhe", "intensitz", "classificatiom")):
        las[name] = np.arange(10) + 100 * number
    las["zq"] = np.arange(10) + 300
    las.write(tmp_path / "a.las")
    raw = (tmp_path / "a.las").read_bytes()
    raw = raw.replace(b"zq\0", b"z\0\0")
    for plain, name in ((b"hxhe", b"h\xf6he"), (b"intensitz", b"intensity"), (b"classificatiom", b"classification")):
        raw = raw.replace(plain, name)
    (tmp_path / "a.las").write_bytes(raw)
    with pytest.warns(StreamsegWarning, match=r"two dimensions called '(intensity|classification)'.*'extra_") as told:
        cloud = open_cloud(tmp_path / "a.las")
    assert len(told) == 2
    names = ("höhe", "extra_intensity", "extra_classification", "z", "intensity", "classification")
    (chunk,) = cloud.chunks(attributes=names)
    expected = [*(np.arange(10) + 100 * number for number in range(4)), np.full(10, 7), np.full(10, 2)]
    for name, values in zip(names, expected, strict=True):
        assert np.array_equal(chunk.attributes[name], values), name
    write_labelled(cloud, tmp_path / "b.laz", Labels())
    (described,) = (record.data for record in take_apart(tmp_path / "b.laz").vlrs if record.number == 4)
    stored = [described[at + 4 : at + 36].split(b"\0")[0] for at in range(0, len(described), 192)]
    assert stored == [b"h\xf6he", b"intensity", b"classification", b"z", b"SegmentID"]


@pytest.mark.parametrize("point_format", [9, 10])
def test_waveforms_of_several_channels_are_not_compressed(tmp_path: Path, point_format: int) -> None:
    """The encoder mixes them up."""
    write_odd(tmp_path / "a.las", point_format, 4)
    cloud = open_cloud(tmp_path / "a.las")
    with pytest.raises(InvalidInput, match=rf"point format {point_format} and has several scanner channels"):
        check_kind(cloud, tmp_path / "b.laz")
    with pytest.raises(InvalidInput, match="several scanner channels"):
        write_labelled(cloud, tmp_path / "b.laz", Labels())
    assert not (tmp_path / "b.laz").exists()


def test_waveforms_that_do_not_come_along_are_told(tmp_path: Path) -> None:
    header = laspy.LasHeader(version="1.3", point_format=4)
    header.global_encoding.waveform_data_packets_external = True
    las = laspy.LasData(header)
    las.X = np.arange(10)
    las.write(tmp_path / "flight.las")
    with pytest.warns(StreamsegWarning, match=r"waveforms of flight\.las are in flight\.wdp, which is not copied"):
        write_labelled(open_cloud(tmp_path / "flight.las"), tmp_path / "b.laz", Labels())


def test_extended_records_that_are_cut_off_are_told(tmp_path: Path) -> None:
    write_odd(tmp_path / "a.las", 6, 4)
    raw = (tmp_path / "a.las").read_bytes()
    (tmp_path / "a.las").write_bytes(raw[:-10])
    with pytest.warns(StreamsegWarning, match=r"announces 2 extended records, 1 of them lie inside"):
        write_labelled(open_cloud(tmp_path / "a.las"), tmp_path / "b.las", Labels())
    assert len(take_apart(tmp_path / "b.las").evlrs) == 1


def test_ids_that_need_64_bits_have_them(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((3, 3)))
    with LabelSpool() as labels:
        labels.add([0, 1, 2], [1, -1, 2**31])
        write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.las", labels)
    written = laspy.read(tmp_path / "b.las")["SegmentID"]
    assert written.dtype == np.int64
    assert written.tolist() == [1, -1, 2**31]
    with LabelSpool() as labels:
        labels.add([0, 1, 2], [1, -1, 2**31 - 1])
        write_labelled(open_cloud(tmp_path / "b.las"), tmp_path / "c.las", labels)
    written = laspy.read(tmp_path / "c.las")["SegmentID"]
    assert (written.dtype, written.tolist()) == (np.int32, [1, -1, 2**31 - 1])


def test_an_id_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    class Lying(Labels):
        def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
            return np.arange(start, stop) + 2**40, np.ones(stop - start, np.bool_)

    np.save(tmp_path / "a.npy", np.zeros((3, 3)))
    with pytest.raises(InvalidInput, match="does not fit into int32"):
        write_labelled(open_cloud(tmp_path / "a.npy"), tmp_path / "b.las", Lying())
    assert not (tmp_path / "b.las").exists()


def test_chunks_of_wide_points_are_bounded_in_bytes(tmp_path: Path) -> None:
    """The proof of a chunk holds it; so does a compressor that works in threads."""
    width, count = 4_000, 9_000
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.add_extra_dim(laspy.ExtraBytesParams("mine", f"{width}u1"))
    las = laspy.LasData(header)
    las.X = np.arange(count)
    las.points.array["mine"][:, ::1000] = np.arange(count)[:, None] % 251
    las.write(str(tmp_path / "a.las"))
    raw = bytearray((tmp_path / "a.las").read_bytes())
    raw[227 + 2 : 227 + 18] = b"nobody".ljust(16, b"\0")  # hides the record that describes them
    (tmp_path / "a.las").write_bytes(raw)
    write_labelled(open_cloud(tmp_path / "a.las"), tmp_path / "b.laz", Labels())
    with laspy.open(tmp_path / "b.laz") as reader:
        vlr = lazrs.LazVlr(bytes(reader.header.vlrs.get("LasZipVlr")[0].record_data))
        assert (16 - 1) * 1e6 < vlr.chunk_size() * reader.header.point_format.size <= 16 * 2**20
    cloud = open_cloud(tmp_path / "b.laz")
    points = np.concatenate([chunk.points for chunk in cloud.chunks()])
    assert cloud.damage is None
    assert np.array_equal(points[:, 0], np.arange(count))
    new = laspy.read(tmp_path / "b.laz").points.array["ExtraBytes"]
    assert np.array_equal(new, las.points.array["mine"])


def test_an_extended_record_is_read_when_it_is_written(tmp_path: Path) -> None:
    """A file that becomes shorter meanwhile is told; a map of it would end the process."""
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.X = np.arange(5)
    wkt = laspy.VLR("LASF_Projection", 2112, "", b"PROJCS" + b" " * 3_000_000)
    las.evlrs = laspy.vlrs.vlrlist.VLRList([wkt])
    path = tmp_path / "a.las"
    las.write(str(path))
    cloud = open_cloud(path)
    (record,) = cloud.sources[0].evlrs()  # type: ignore[attr-defined]
    assert cloud.coordinate_system is None
    assert [len(block) for block in record.data.blocks()] == [1 << 20, 1 << 20, 3_000_006 - (2 << 20)]
    write_labelled(cloud, tmp_path / "b.las", Labels())
    assert take_apart(tmp_path / "b.las").evlrs[0].data == wkt.record_data
    os.truncate(path, path.stat().st_size - 2_000_000)
    with pytest.raises(FileError, match=r"a\.las became shorter while it was read"):
        bytes(record.data)
