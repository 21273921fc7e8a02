"""What clouds say of their coordinates, and that degrees and mixed units are never taken in silence."""

from __future__ import annotations

import struct
import warnings
from math import inf, nan
from pathlib import Path

import laspy
import numpy as np
import pytest

import streamseg as ss
from streamseg.description import describe
from streamseg.errors import StreamsegWarning
from streamseg.io import open_cloud, write_labelled
from streamseg.io.coordinate_system import LONGITUDE_LATITUDE, CoordinateSystem, judged, read_system
from streamseg.io.las_records import Record, new_record

UTM = 'PROJCS["UTM 15N",GEOGCS["NAD83",DATUM["D",SPHEROID["S",1,2]],UNIT["degree",0.0174532925199433]],UNIT["metre",1]]'
WGS84 = 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.25]],UNIT["degree",0.0174532925199433]]'
FEET = 'PROJCS["Oregon",GEOGCS["N",UNIT["degree",0.0174532925199433]],UNIT["Foot_US",0.304800609601219]]'
WKT2 = (
    'PROJCRS["WGS 84 / UTM zone 32N",'
    'BASEGEOGCRS["WGS 84",DATUM["W",ELLIPSOID["W",6378137,298.2,LENGTHUNIT["metre",1]]]],'
    'CONVERSION["UTM zone 32N",METHOD["TM"],PARAMETER["Longitude",9,ANGLEUNIT["degree",0.0174532925199433]]],'
    'CS[Cartesian,2],AXIS["(E)",east,ORDER[1],LENGTHUNIT["metre",1]],AXIS["(N)",north,LENGTHUNIT["metre",1]],'
    'ID["EPSG",32632]]'
)
GEOGRAPHIC_2 = (
    'GEOGCRS["WGS 84 (3D)",DATUM["W",ELLIPSOID["W",6378137,298.2,LENGTHUNIT["metre",1]]],CS[ellipsoidal,3],'
    'AXIS["lat",north,ANGLEUNIT["degree",0.0174532925199433]],AXIS["lon",east,ANGLEUNIT["degree",0.0174532925199433]],'
    'AXIS["h",up,LENGTHUNIT["metre",1]]]'
)
GEOCENTRIC = (
    'GEODCRS["WGS 84",DATUM["W",ELLIPSOID["W",1,2]],CS[Cartesian,3],AXIS["X",geocentricX],LENGTHUNIT["metre",1]]'
)
HEIGHT = 'VERT_CS["NAVD88",VERT_DATUM["N",2005],UNIT["foot",0.3048]]'
BOUND = f'BOUNDCRS[SOURCECRS[{WKT2}],TARGETCRS[{GEOGRAPHIC_2}],ABRIDGEDTRANSFORMATION["x"]]'
BAD = [
    "",
    "PROJCS",
    'PROJCS["a"',
    "]]",
    "A[" * 1000,
    '"',
    'UNIT["metre",1]',
    "\x00\x01garbage[",
    'VERT_CS["only a height"]',
]


def of_wkt(text: str) -> CoordinateSystem | None:
    return read_system([new_record(("LASF_Projection", 2112), "", text.encode() + b"\0")], True)[0]


def keys(*entries: tuple[int, int, int, int], texts: bytes = b"", doubles: tuple[float, ...] = ()) -> list[Record]:
    directory = struct.pack("<4H", 1, 1, 0, len(entries)) + b"".join(struct.pack("<4H", *entry) for entry in entries)
    return [
        new_record(("LASF_Projection", number), "", data)
        for number, data in ((34735, directory), (34736, struct.pack(f"<{len(doubles)}d", *doubles)), (34737, texts))
    ]


def of_keys(*entries: tuple[int, int, int, int], texts: bytes = b"", doubles: tuple[float, ...] = ()) -> object:
    system = read_system(keys(*entries, texts=texts, doubles=doubles), False)[0]
    return system and tuple(system)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (UTM, ("UTM 15N", "m", False, None)),
        (WGS84, ("WGS 84", "degrees", True, None)),
        (FEET, ("Oregon", "US survey ft", False, None)),
        (WKT2, ("WGS 84 / UTM zone 32N", "m", False, None)),
        (GEOGRAPHIC_2, ("WGS 84 (3D)", "degrees", True, "m")),
        (GEOCENTRIC, ("WGS 84", "m", False, None)),
        (f'COMPD_CS["both",{UTM},{HEIGHT}]', ("both", "m", False, "ft")),
        (f'COMPOUNDCRS["both",{WKT2},VERTCRS["h",CS[vertical,1],AXIS["up",up],LENGTHUNIT["metre",1]]]',
         ("both", "m", False, "m")),
        (f'COMPD_CS["both",{WGS84},{HEIGHT}]', ("both", "degrees", True, "ft")),
        (BOUND, ("WGS 84 / UTM zone 32N", "m", False, None)),
        (UTM.replace("[", " [ ").replace(",", "\n , ").replace("PROJCS", "projcs"), ("UTM 15N", "m", False, None)),
        (UTM.replace("[", "(").replace("]", ")"), ("UTM 15N", "m", False, None)),
        ('PROJCS["say ""hello""",UNIT["chain",20.1168]]', ('say "hello"', "chain", False, None)),
    ],
)  # fmt: skip
def test_well_known_text_is_understood(text: str, expected: tuple[object, ...]) -> None:
    system = of_wkt(text)
    assert system is not None
    assert tuple(system) == expected


@pytest.mark.parametrize("text", BAD)
def test_text_that_is_none_says_nothing(text: str) -> None:
    assert of_wkt(text) is None


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([(1024, 0, 1, 2), (2048, 0, 1, 4326), (2054, 0, 1, 9102)], ("EPSG:4326", "degrees", True, None)),
        ([(2048, 0, 1, 4326)], ("EPSG:4326", "degrees", True, None)),
        ([(1024, 0, 1, 1), (2048, 0, 1, 4269), (3072, 0, 1, 26915)], ("EPSG:26915", "m", False, None)),
        ([(3072, 0, 1, 2154)], ("EPSG:2154", None, False, None)),
        ([(3072, 0, 1, 2913), (3076, 0, 1, 9002), (4099, 0, 1, 9001)], ("EPSG:2913", "ft", False, "m")),
        ([(3072, 0, 1, 2913), (3076, 0, 1, 9003), (4096, 0, 1, 6360)],
         ("EPSG:2913", "US survey ft", False, "US survey ft")),
        ([(1024, 0, 1, 3), (2048, 0, 1, 4326)], ("EPSG:4326, geocentric", None, False, None)),
        ([(1025, 0, 1, 1)], None),
        ([], None),
    ],
)  # fmt: skip
def test_keys_are_understood(entries: list[tuple[int, int, int, int]], expected: object) -> None:
    assert of_keys(*entries) == expected


def test_citations_name_the_system_and_sizes_of_units_count() -> None:
    named = of_keys((1024, 0, 1, 1), (1026, 34737, 22, 0), (3072, 0, 1, 32615), texts=b"WGS 84 / UTM zone 15N|")
    assert named == ("WGS 84 / UTM zone 15N", "m", False, None)
    own = ((1024, 0, 1, 1), (3072, 0, 1, 32767), (3073, 34737, 30, 0), (3076, 0, 1, 32767), (3077, 34736, 1, 0))
    assert of_keys(*own, texts=b"PCS Name = Mine|Datum = X|", doubles=(0.3048,)) == ("Mine", "ft", False, None)
    assert of_keys(*own, texts=b"", doubles=()) == ("a system of its own", None, False, None)


def test_measured_clouds(data: Path) -> None:
    def said(name: str) -> object:
        return open_cloud(data / name).coordinate_system

    assert said("als/autzen_trim.laz") == ("NAD_1983_HARN_Lambert_Conformal_Conic", "ft", False, None)
    assert said("als/hawaii_pass.laz") == ("WGS 84 / UTM zone 5N", "m", False, None)
    assert said("als/lidarhd_77050_627755.laz") == ("RGF93 v1 / Lambert-93", "m", False, None)
    assert said("als/bcts_2.laz") == ("NAD83 / BC Albers", "m", False, "m")
    assert said("als/delft_ahn3.laz") is None
    cautious = {path.name: open_cloud(path).caution for path in data.glob("*/*.laz")}
    assert {name for name, caution in cautious.items() if caution} == set()


def write(path: Path, *wkt: str, degrees: bool = True, count: int = 20, scale_z: float = 0.01) -> Path:
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.array([1e-7, 1e-7, scale_z] if degrees else [0.01] * 3)
    header.global_encoding.wkt = bool(wkt)
    header.vlrs.extend(laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0") for text in wkt)
    las = laspy.LasData(header)
    step, start = (1e-5, 8.0) if degrees else (1.0, 500_000.0)
    las.x, las.y, las.z = start + np.arange(count) * step, np.full(count, 50.0), np.zeros(count)
    las.write(path)
    return path


def test_degrees_are_told_once_in_every_run_and_stand_beside_every_proof(tmp_path: Path) -> None:
    path, method = write(tmp_path / "a.las", WGS84), ss.Proximity(2.0)
    told = "longitude and latitude in degrees"
    for run in (
        lambda: ss.segment(path, method),
        lambda: ss.segment_static(path, method),
        lambda: list(ss.stream(path, method)),
        lambda: ss.segment_file(path, tmp_path / "o.las", method, overwrite=True),
        lambda: ss.verify(path, method),
        lambda: ss.plan(path, method),
    ):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            answer = run()
        assert [told in str(one.message) for one in caught] == [True], run
        if isinstance(answer, ss.Verification):
            assert answer.is_proven
            assert told in str(answer)
        if hasattr(answer, "promise"):
            assert told in answer.promise or told in str(answer)


@pytest.mark.parametrize(("scale_z", "is_told"), [(0.01, True), (0.001, True), (1e-7, False), (1e-6, False)])
def test_degrees_without_a_system_are_told_only_where_it_is_sure(tmp_path: Path, scale_z: float, is_told: bool) -> None:
    """A terrestrial scan around its origin has fine steps too, but as fine ones in height."""
    caution = open_cloud(write(tmp_path / "a.las", scale_z=scale_z)).caution
    assert (caution is not None and "look like longitude and latitude" in caution) == is_told


def test_a_system_that_the_coordinates_contradict_is_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.las", WGS84, degrees=False, count=900)
    cloud = open_cloud(path)
    assert cloud.coordinate_system is not None
    assert cloud.coordinate_system.is_geographic
    assert cloud.unit is None
    with pytest.warns(
        StreamsegWarning, match=r"says that x and y are longitude and latitude, but they are beyond ±360"
    ):
        ss.segment(path, ss.Proximity(2.0))
    lines = dict(describe(path))
    assert lines["caution"] == cloud.caution
    assert "degrees" not in lines["spacing"]
    assert "try" in lines
    assert "project" not in lines


@pytest.mark.parametrize(
    "box",
    [
        None,
        [(8.0, 9.0), (50.0, 51.0)],
        [(35.0, 36.0), (139.0, 140.0)],
        [(inf, -inf), (inf, -inf)],
        [(nan, 1.0), (0.0, 1.0)],
    ],
)
def test_a_geographic_system_is_believed_where_no_coordinate_says_otherwise(box: list[tuple[float, float]]) -> None:
    assert judged(LONGITUDE_LATITUDE, box).in_degrees


def test_columns_that_are_called_degrees_and_are_none_are_told_by_info(tmp_path: Path) -> None:
    rows = np.random.default_rng(1).uniform([5e5, 5e6, 0], [5e5 + 30, 5e6 + 30, 30], (900, 3))
    for name, offset, is_said in (("meters", 0.0, False), ("degrees", [500_000, 5_000_000, 0], True)):
        np.savetxt(path := tmp_path / f"{name}.csv", rows - offset, "%.3f", ",", header="lon,lat,z", comments="")
        lines = dict(describe(path))
        assert ("are longitude and latitude in degrees" in lines["caution"]) == ("degrees" in lines) == is_said
        assert ("try" in lines) == ("beyond ±360" in lines["caution"]) == (not is_said)


def test_info_proposes_nothing_for_what_only_looks_like_degrees(tmp_path: Path) -> None:
    lines = dict(describe(write(tmp_path / "a.las", scale_z=0.01)))
    assert "look like longitude and latitude" in lines["caution"]
    assert "in_srs=EPSG:4326 --filters.reprojection.out_srs=EPSG:32632" in lines["project"]
    assert "try" not in lines


def test_heights_in_another_unit_are_told(tmp_path: Path) -> None:
    path = write(tmp_path / "a.las", f'COMPD_CS["both",{UTM},{HEIGHT}]', degrees=False)
    with pytest.warns(StreamsegWarning, match=r"x and y are in m, z is in ft \(both\)"):
        ss.segment(path, ss.Proximity(2.0))


class Labels:
    def read(self, start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        return np.arange(start, stop), np.ones(stop - start, np.bool_)


def test_the_system_of_the_first_file_that_has_one_is_written(tmp_path: Path) -> None:
    paths = [write(tmp_path / "a.las", degrees=False), write(tmp_path / "b.las", UTM, degrees=False)]
    with pytest.warns(StreamsegWarning, match=r"a\.las names no coordinate system; that of .*b\.las is taken for all"):
        cloud = open_cloud(paths)
    assert cloud.coordinate_system == ("UTM 15N", "m", False, None)
    write_labelled(cloud, tmp_path / "c.laz", Labels())
    header = laspy.read(tmp_path / "c.laz").header
    assert header.vlrs.get("WktCoordinateSystemVlr")[0].string == UTM
    assert header.global_encoding.wkt
    assert open_cloud(tmp_path / "c.laz").coordinate_system == cloud.coordinate_system


def test_a_system_behind_the_points_is_found_and_kept(tmp_path: Path) -> None:
    path = write(tmp_path / "a.las", degrees=False)
    text = UTM.encode() + b"\0"
    raw = bytearray(path.read_bytes())
    struct.pack_into("<QI", raw, 235, len(raw), 1)
    raw += struct.pack("<2x16sHQ32s", b"LASF_Projection", 2112, len(text), b"far behind") + text
    path.write_bytes(raw)
    assert open_cloud(path).coordinate_system == ("UTM 15N", "m", False, None)
    write_labelled(open_cloud(path), tmp_path / "b.laz", Labels())
    assert open_cloud(tmp_path / "b.laz").coordinate_system == ("UTM 15N", "m", False, None)
