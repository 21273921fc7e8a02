"""Headers of ``.npy`` files: what NumPy writes is read, and what is damaged is told first."""

from __future__ import annotations

import io
import tracemalloc
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from streamseg import Proximity, segment, stream
from streamseg.errors import FileError, InvalidInput, StreamsegError, StreamsegWarning
from streamseg.io import limits, npy, open_cloud

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from streamseg.io import Cloud


def points_of(cloud: Cloud, size: int = 250_000) -> NDArray[np.float64]:
    return np.concatenate([chunk.points for chunk in cloud.chunks(size)])


def with_header(header: str | bytes, version: tuple[int, int] = (1, 0), data: bytes = b"") -> bytes:
    """Write a header as it is given."""
    raw = header if isinstance(header, bytes) else header.encode("utf-8" if version == (3, 0) else "latin-1")
    length = len(raw).to_bytes(2 if version == (1, 0) else 4, "little")
    return b"\x93NUMPY" + bytes(version) + length + raw + data


def described(descr: Any, shape: Any, by_column: Any = False) -> str:
    return f"{{'descr': {descr!r}, 'fortran_order': {by_column!r}, 'shape': {shape}, }}\n"


def structured(count: int = 5, **others: str) -> NDArray[Any]:
    table = np.zeros(count, [("x", "f8"), ("y", "f4"), ("z", "i2"), *others.items()])
    table["x"], table["y"], table["z"] = np.arange(3 * count).reshape(count, 3).T
    return table


# Fields beside x, y and z, and whether they are attributes.
FIELDS = {
    "f2": True, "u8": True, ">i4": True, "?": True, "c16": False, "M8[s]": False, "m8[ms]": False, "V3": False,
    "S4": False, "U2": False, "(3,)f8": False, "(2,2)i1": False,
}  # fmt: skip


@pytest.mark.parametrize("field", FIELDS)
def test_fields_of_all_types_beside_x_y_and_z(tmp_path: Path, field: str) -> None:
    table = structured(5, other=field, last="f8")
    table["last"] = np.arange(5)
    np.save(tmp_path / "a.npy", table)
    cloud = open_cloud(tmp_path / "a.npy")
    assert ("other" in cloud.dimensions) == FIELDS[field]
    assert points_of(cloud, 2).tolist() == np.arange(15.0).reshape(5, 3).tolist()
    assert np.concatenate([chunk.attributes["last"] for chunk in cloud.chunks(2, ["last"])]).tolist() == [0, 1, 2, 3, 4]


def test_fields_with_gaps_and_nested_ones(tmp_path: Path) -> None:
    gaps = {"names": ["z", "x", "y"], "formats": ["u1", ">f8", "f2"], "offsets": [3, 8, 20], "itemsize": 40}
    for dtype in (gaps, np.dtype([("a", "u1"), ("x", "f8"), ("y", "f8"), ("z", "f8")], align=True)):
        table = np.zeros(2, dtype)
        table["x"], table["y"], table["z"] = [[1, 4], [2, 5], [3, 6]]
        np.save(tmp_path / "a.npy", table)
        assert points_of(open_cloud(tmp_path / "a.npy")).tolist() == [[1, 2, 3], [4, 5, 6]]
    np.save(tmp_path / "a.npy", np.zeros(2, [("p", [("x", "f8"), ("y", "f8"), ("z", "f8")])]))
    with pytest.raises(InvalidInput, match="needs the numeric fields x, y and z; it has p; which of them is x and y"):
        open_cloud(tmp_path / "a.npy")


def test_names_of_fields_in_utf_8(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="Stored array in format 3.0"):
        np.save(tmp_path / "a.npy", structured(5, **{"höhe ½ 高": "f4"}))
    assert open_cloud(tmp_path / "a.npy").dimensions == ("x", "y", "z", "höhe ½ 高")


def test_headers_of_python_2(tmp_path: Path) -> None:
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2L, 3L), }\n"
    (tmp_path / "a.npy").write_bytes(with_header(header, data=np.arange(6.0).tobytes()))
    assert points_of(open_cloud(tmp_path / "a.npy")).tolist() == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize(
    ("names", "taken"),
    [
        ("x X y z", "x y z"),
        ("x X Y Z", "X Y Z"),
        ("X Y Z i", "X Y Z"),
        ("easting northing height z", "easting northing z"),
        ("x y z X Y Z", None),
        ("x y Y z Z X", None),
        ("x northing z", None),
    ],
)
def test_x_beside_another_x(tmp_path: Path, names: str, taken: str | None) -> None:
    table = np.zeros(1, [(name, "f8") for name in names.split()])
    for place, name in enumerate(names.split()):
        table[name] = place
    np.save(tmp_path / "a.npy", table)
    if taken is None:
        with pytest.raises(InvalidInput, match=r"needs the numeric fields x, y and z; .* not clear"):
            open_cloud(tmp_path / "a.npy")
    else:
        assert points_of(open_cloud(tmp_path / "a.npy")).tolist() == [[names.split().index(n) for n in taken.split()]]


def test_fields_in_degrees_are_told(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros(1, [("lat", "f8"), ("lon", "f8"), ("h", "f8")]))
    cloud = open_cloud(tmp_path / "a.npy")
    assert cloud.caution is not None
    assert "longitude and latitude in degrees" in cloud.caution


F8 = "<f8"
XYZ = [("x", F8), ("y", F8), ("z", F8)]

# name: (content, error, what it says)
REFUSED: dict[str, tuple[bytes, type[StreamsegError], str]] = {
    "wide": (with_header(described(F8, (0, 10**9))), InvalidInput, "has 1,000,000,000 columns, allowed: 10,000"),
    "wide by columns": (with_header(described(F8, (4, 10**9), True)), InvalidInput, "columns, allowed: 10,000"),
    "too wide for an integer": (with_header(described(F8, (0, 10**30))), InvalidInput, "columns, allowed: 10,000"),
    "many fields": (
        with_header(described([(f"{i}", "u1") for i in range(3800)], (1,)), (2, 0)),
        InvalidInput,
        "needs the numeric fields x, y and z; it has 0, 1, 2, .*, 19, …; which of them is x and y and z is not clear",
    ),
    "large fields": (
        with_header(described([*XYZ, ("a", "V2000000000")], (1,))),
        InvalidInput,
        "2,000,000,024 bytes per point, allowed: 1,048,576",
    ),
    "fields beyond all bounds": (with_header(described([*XYZ, ("a", "V9000000000")], (1,))), StreamsegError, "V9000"),
    "empty rows": (with_header(described("<f8", (3, 0))), InvalidInput, r"has shape \(3, 0\), expected \(n, 3\)"),
    "no rows": (with_header(described(F8, (0, 3))), InvalidInput, "has no points"),
    "a point": (with_header(described(F8, ())), InvalidInput, r"has shape \(\), expected"),
    "a cube": (with_header(described(F8, (2, 3, 4)), data=bytes(999)), InvalidInput, r"has shape \(2, 3, 4\)"),
    "a table of fields": (with_header(described(XYZ, (2, 3))), InvalidInput, r"holds fields and has shape \(2, 3\)"),
    "negative": (with_header(described(F8, (-3, 3))), FileError, r"its shape is \(-3, 3\)"),
    "booleans": (with_header(described(F8, (True, 3))), FileError, "its shape is"),
    "fractions": (with_header(described(F8, (3.0, 3))), FileError, "its shape is"),
    "no tuple": (with_header(described(F8, [3, 3])), FileError, "its shape is"),
    "order": (with_header(described(F8, (3, 3), 1)), FileError, "its fortran_order is 1, allowed: True, False"),
    "a key too many": (with_header("{'descr':'<f8','fortran_order':False,'shape':(1,),'a':1}"), FileError, "its head"),
    "no dictionary": (with_header("[1, 2]"), FileError, r"its header is \[1, 2\]"),
    "code": (with_header("__import__('os').system('true')"), FileError, "its header is __import__"),
    "nonsense": (with_header("('descr': 3"), FileError, "its header is"),
    "deep": (with_header("(" * 30_000), FileError, r"its header is \(\(\(.*…$"),
    "deep types": (with_header(described(0, (1,)).replace("0", "[" * 90 + "]" * 90, 1)), FileError, "its items are"),
    "no type": (with_header(described("<q9", (1, 3))), FileError, "its items are <q9"),
    "a type of nothing": (with_header(described("|V0", (5, 3))), InvalidInput, "holds .*V0, expected numbers"),
    "text": (with_header(described("<U5", (5, 3))), InvalidInput, "holds <U5, expected numbers"),
    "objects": (with_header(described("|O", (5, 3))), InvalidInput, "holds Python objects, which are never read"),
    "a field of objects": (
        with_header(described([*XYZ, ("o", "|O")], (5,)), data=bytes(999)),
        InvalidInput,
        "holds Python objects, which are never read; save numbers only",
    ),
    "names twice": (with_header(described([*XYZ, ("x", F8)], (5,))), FileError, "its items are"),
    "x that is complex": (with_header(described([("x", "<c16"), *XYZ[1:]], (5,))), InvalidInput, "numeric fields x, y"),
    "x that is true or false": (with_header(described([("x", "|b1"), *XYZ[1:]], (5,))), InvalidInput, "numeric fields"),
    "one field of three": (with_header(described([("xyz", F8, (3,))], (5,))), InvalidInput, "it has xyz"),
    "half a character": (with_header("{'descr': [('\\ud800', '<f8')], 'fortran_order': False, 'shape': (1,)}"),
                         FileError, "a field is called"),
    "no UTF-8": (with_header(b"{'descr': '\xff'}", (3, 0)), FileError, "its header is not written in UTF-8"),
    "version": (with_header(described(F8, (1, 3)), (4, 7)), FileError, "its version is 4.7, known are 1.0, 2.0"),
    "no version": (b"\x93NUMPY", FileError, "its version is , known"),
    "a long header": (b"\x93NUMPY\x02\0\xff\xff\xff\xff{}", FileError, "its header is 4,294,967,295 bytes long"),
    "a header cut off": (with_header(described(F8, (1, 3)))[:40], FileError, "it ends within its header"),
    "zip": (b"PK\x03\x04" + bytes(99), FileError, r"it does not begin with \\x93NUMPY"),
    "points that are not there": (with_header(described(F8, (10**15, 3))), FileError, "none of its 1,000,000,000"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_headers_that_are_refused(tmp_path: Path, case: str) -> None:
    content, kind, said = REFUSED[case]
    (tmp_path / "a.npy").write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(kind, match=said) as caught:
            points_of(open_cloud(tmp_path / "a.npy"))
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "a.npy"))
    assert "\n" not in message
    assert len(message) < len(str(tmp_path)) + 400


@pytest.mark.parametrize("by_column", [False, True])
def test_blocks_are_bounded_in_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by_column: bool) -> None:
    monkeypatch.setattr(npy, "BLOCK_BYTES", 10_000)
    table = np.arange(7000.0).reshape(7, 1000)
    np.save(tmp_path / "a.npy", np.asfortranarray(table) if by_column else table)
    cloud = open_cloud(tmp_path / "a.npy")
    chunks = list(cloud.chunks(attributes=["column_1000"]))
    assert [len(chunk.points) for chunk in chunks] == ([7] if by_column else [1] * 7)
    assert np.concatenate([chunk.points for chunk in chunks]).tolist() == table[:, :3].tolist()
    assert np.concatenate([chunk.attributes["column_1000"] for chunk in chunks]).tolist() == table[:, -1].tolist()


def test_as_many_columns_as_are_allowed(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.ones((2, limits.MOST_COLUMNS), "u1"))
    assert len(open_cloud(tmp_path / "a.npy").dimensions) == limits.MOST_COLUMNS


def test_any_nan_is_read_without_a_complaint(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((1, 3), 0x7F800001, "u4").view("f4"))
    assert np.isnan(points_of(open_cloud(tmp_path / "a.npy"))).all()


@pytest.mark.parametrize("dtype", ["i8", "u8"])
def test_whole_numbers_that_floats_do_not_hold_are_refused(tmp_path: Path, dtype: str) -> None:
    np.save(tmp_path / "a.npy", np.full((2, 3), 2**53, dtype))
    assert points_of(open_cloud(tmp_path / "a.npy")).tolist() == [[2.0**53] * 3] * 2
    np.save(tmp_path / "a.npy", np.full((2, 3), 2**53 + 1, dtype))
    with pytest.raises(
        InvalidInput, match="coordinates such as 9007199254740993: whole numbers beyond 9007199254740992"
    ):
        points_of(open_cloud(tmp_path / "a.npy"))


@pytest.mark.parametrize("table", [structured(9, i="u2"), np.ones((9, 4), ">f4")], ids=["fields", "columns"])
def test_every_flipped_bit_of_a_header_is_read_or_told(tmp_path: Path, table: NDArray[Any]) -> None:
    written = io.BytesIO()
    np.save(written, table)
    content = written.getvalue()
    path = tmp_path / "a.npy"
    told = 0
    for bit in range(8 * (len(content) - table.nbytes)):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        try:
            assert len(points_of(open_cloud(path))) <= 99
        except StreamsegError:
            told += 1
    # Blanks at the end may be anything that Python passes over; half of the header matters at least.
    assert told > 400


@pytest.mark.parametrize("by_column", [False, True])
@pytest.mark.parametrize("rows", [10**30, 2**63, 2**62, 11])
def test_no_more_points_count_than_the_file_has_room_for(tmp_path: Path, rows: int, by_column: bool) -> None:
    path = tmp_path / "a.npy"
    path.write_bytes(with_header(described("<f8", (rows, 3), by_column), data=np.zeros((10, 3)).tobytes()))
    cloud = open_cloud(path)
    assert (cloud.point_count or 0) <= 30
    if by_column and rows > 30:  # not even the first column is whole
        with pytest.raises(FileError, match="is damaged before its first point"):
            segment(path, Proximity(1.0))
    else:
        run = stream(path, Proximity(1.0))
        with pytest.warns(StreamsegWarning, match=f"is damaged after point .* of {rows:,};"):
            assert sum(len(span.point_ids) for span in run) == (8 if by_column else 10)
