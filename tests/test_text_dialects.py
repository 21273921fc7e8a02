"""Text clouds as programs and people write them: read as they are meant, or refused in a sentence that helps."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

import streamseg as ss
from streamseg.description import describe
from streamseg.errors import FileError, InvalidInput, StreamsegWarning
from streamseg.io import limits, open_cloud, read_labels, text_lines, write_labelled

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from streamseg.io import Cloud

TWO = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


class Counted:
    """Labels that are the ids of the points."""

    def read(self, start: int, stop: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return np.arange(start, stop), np.ones(stop - start, np.bool_)


def written(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def points_of(cloud: Cloud) -> NDArray[np.float64]:
    return np.concatenate([chunk.points for chunk in cloud.chunks()])


# name: (suffix, content, names of the columns)
READ: dict[str, tuple[str, str | bytes, str]] = {
    "names behind a hash": (".txt", "# id x y z\n9 1 2 3\n9 4 5 6\n", "id x y z"),
    "names close to the hash": (".txt", "#id x y z\n9 1 2 3\n9 4 5 6\n", "id x y z"),
    "names behind several hashes": (".txt", "## id x y z\n9 1 2 3\n9 4 5 6\n", "id x y z"),
    "names behind slashes": (".txt", "//id x y z\n9 1 2 3\n9 4 5 6\n", "id x y z"),
    "names behind slashes and a blank": (".txt", "// id x y z\n9 1 2 3\n9 4 5 6\n", "id x y z"),
    "names between other comments": (".txt", "# by me\n# z y x\n# 2020\n3 2 1\n6 5 4\n", "z y x"),
    "names behind a colon": (".txt", "# columns: id x y z\n9 1 2 3\n9 4 5 6\n", "id x y z"),
    "names between blanks, numbers between commas": (".csv", "# i x y z\n9,1,2,3\n9,4,5,6\n", "i x y z"),
    "names between commas, numbers between blanks": (".txt", "i, x, y, z\n9 1 2 3\n9 4 5 6\n", "i x y z"),
    "names behind a hash with commas and blanks": (".txt", "# i, x, y, z\n9 1 2 3\n9 4 5 6\n", "i x y z"),
    "a plain line before one behind a hash": (".txt", "z y x\n# x y z\n3 2 1\n6 5 4\n", "z y x"),
    "a comment of other length": (".txt", "# by hand\n1 2 3 7\n4 5 6 7\n", "x y z column_4"),
    "a comment that names fewer": (".txt", "# x y z\n1 2 3 7\n4 5 6 7\n", "x y z column_4"),
    "a sentence": (".txt", "# made by hand.\n1 2 3\n4 5 6\n", "x y z"),
    "a sentence on x y z": (".txt", "# points in x y z\n1 2 3\n4 5 6\n", "x y z"),
    "a long sentence on x y z": (".txt", "# we turned the axes id x y z a bit\n1 2 3\n4 5 6\n", "x y z"),
    "numbers behind slashes": (".txt", "// 7 8 9 7\n1 2 3\n4 5 6\n", "x y z"),
    "numbers in a comment": (".txt", "# x y 3\n1 2 3\n4 5 6\n", "x y z"),
    "CloudCompare": (".asc", "//X Y Z R G B\n2\n1 2 3 9 9 9\n4 5 6 9 9 9\n", "X Y Z R G B"),
    "count, then names": (".txt", "2\nX Y Z\n1 2 3\n4 5 6\n", "X Y Z"),
    "several scans": (".pts", "1\n1 2 3 7\n1\n4 5 6 7\n", "x y z column_4"),
    "an empty scan first": (".pts", "0\n2\n1 2 3\n4 5 6\n", "x y z"),
    "no count": (".pts", "1 2 3\n4 5 6\n", "x y z"),
    "a comma at the end": (".csv", "1,2,3,\n4,5,6,\n", "x y z"),
    "a comma at the end of all lines": (".csv", "x,y,z,\n1,2,3,\n4,5,6,\n", "x y z"),
    "a comma at the end of numbers": (".csv", "x,y,z\n1,2,3, \n4,5,6,\n", "x y z"),
    "a last column that is empty": (".csv", "x;y;z;name\n1;2;3;\n4;5;6;\n", "x y z name"),
    "rows of commas": (".csv", ",,\n1,2,3\n,,\n4,5,6\n", "x y z"),
    "x beside X": (".csv", "X,x,y,z\n9,1,2,3\n9,4,5,6\n", "X x y z"),
    "x among capitals": (".csv", "x,X,Y,Z\n9,1,2,3\n9,4,5,6\n", "x X Y Z"),
    "Latin-1": (".txt", b"x y z h\xf6he\n1 2 3 4\n4 5 6 7\n", "x y z höhe"),
    "UTF-8": (".txt", "x y z höhe à\n1 2 3 à 4\n4 5 6 à 7\n", "x y z höhe à"),
    "UTF-8 with its mark": (".csv", "\ufeffx,y,z,höhe\r\n1,2,3,4\r\n4,5,6,7\r\n", "x y z höhe"),
    "no-break spaces are no blanks": (".txt", "x y z n\n1 2 3 a\xa0b\n4 5 6 c\xa0d\n", "x y z n"),
    "lines end in CR": (".txt", b"1 2 3\r4 5 6", "x y z"),
    "lines end in all ways": (".txt", b"x y z\r\n\n1 2 3\r4 5 6\r\n\r\n", "x y z"),
    "empty columns between tabs": (".txt", "x\ty\tz\tn\ti\n1\t2\t3\t\t5\n4\t5\t6\ta b\t7\n", "x y z n i"),
    "an empty last column": (".txt", "x\ty\tz\tn\n1\t2\t3\t\n4\t5\t6\ta\n", "x y z n"),
    "names with blanks between tabs": (".txt", "Point ID\tx\ty\tz\n9\t1\t2\t3\n9\t4\t5\t6\n", "Point_id x y z"),
    "tabs and blanks": (".txt", "1\t2\t3\n 4  5 \t 6\n", "x y z"),
    "quotes": (".csv", '"x","y","z","n"\n"1","2","3","a,b"\n4,5,6,"c ""d"", e"\n', "x y z n"),
    "quotes between blanks": (".txt", 'n x y z\n"a b" 1 2 3\nc 4 5 6\n', "n x y z"),
    "quotes that mean inches": (".csv", 'x,y,z,n\n1,2,3,5" pipe\n4,5,6,"open\n', "x y z n"),
    "comments behind points": (".txt", "1 2 3 # 4\n4 5 6 # 7 8\n", "x y z"),
    "a hash within a word": (".txt", "x y z n\n1 2 3 tree#4\n4 5 6 1.#IND\n", "x y z n"),
    "signs and points": (".txt", "+1 2. 3e0\n4.00 +5 60E-1\n", "x y z"),
    "whole numbers and colors": (".csv", "1,2,3,10,255,3\n4,5,6,0,25,7\n", "x y z column_4 column_5 column_6"),
}


@pytest.mark.parametrize("case", READ)
def test_dialects_that_are_read(tmp_path: Path, case: str) -> None:
    suffix, content, names = READ[case]
    path = written(tmp_path, f"a{suffix}", content)
    cloud = open_cloud(path)
    assert points_of(cloud).tolist() == TWO
    assert cloud.dimensions == tuple(name.replace("_id", " ID") for name in names.split())
    assert cloud.damage is None
    out = tmp_path / f"b{suffix}"
    write_labelled(cloud, out, Counted())
    ((points, ids),) = read_labels(out)
    assert points.tolist() == TWO
    assert ids.tolist() == [0, 1]
    # Once more, with the ids replaced: nothing is added twice.
    if open_cloud(out).dimensions[-1] == "SegmentID":
        write_labelled(open_cloud(out), tmp_path / f"c{suffix}", Counted())
        assert (tmp_path / f"c{suffix}").read_bytes() == out.read_bytes()


# name: (content, what the message says)
REFUSED: dict[str, tuple[str | bytes, str]] = {
    "names behind a hash that are not clear": (
        "# Nr Rechts Hoch H\n9 1 2 3\n",
        "which of them is x and y is not clear",
    ),
    "names behind slashes that are not clear": ("//a b c\n1 2 3\n", "which of them is x and y and z is not clear"),
    "half of the names": ("# east north up\n1 2 3\n", "which of them is z is not clear: name the columns x, y and z"),
    "x of one kind, y of another": ("x northing z\n1 2 3\n", "which of them is x and y is not clear"),
    "names of fewer columns": ("id x y\n9 1 2 3\n", "does not have one name for each of the 4 columns of line 2"),
    "as R writes it": ('"x" "y" "z"\n"1" 1 2 3\n', "does not have one name for each of the 4 columns of line 2"),
    "names behind a hash of fewer columns": ("# id x y z\n9 1 2 3 4\n", "line 1: '# id x y z' says where x, y and z"),
    "names of one column more": ("id x y z i\n9 1 2 3\n", "does not have one name for each of the 4 columns"),
    "a title": ("OFF\n8 6 0\n", "line 1: 'OFF' is no point, and does not have one name for each .* put # in front"),
    "x twice": ("x x y z\n1 2 3 4\n", "which of x, x is meant is not clear"),
    "all axes twice": ("x y z X Y Z\n1 2 3 4 5 6\n", "which of x, y, z, X, Y, Z is meant is not clear"),
    "twins behind a hash": ("# x y z X Y Z\n1 2 3 4 5 6\n", "which of x, y, .* is meant is not clear"),
    "more columns": ("x y z\n1 2 3\n4 5 6 7\n8 9 10\n", r"line 3: '4 5 6 7' has 4 columns, the first .* line 2, has 3"),
    "more columns in the last line": ("1 2 3\n4 5 6 7", "line 2: '4 5 6 7' has 4 columns"),
    "fewer columns": (
        "\n1 2 3 4\n\n4 5 6\n7 8 9 1\n",
        "line 4: '4 5 6' has 3 columns, the first point, in line 2, has 4",
    ),
    "one column": ("x y z\n1 2 3\n2 2 3\n3 2 3\n1\n5 2 3\n", "line 5: '1' has 1 column,"),
    "a count where none is announced": ("1 2 3\n1\n4 5 6\n", "line 2: '1' has 1 column,"),
    "a word": ("x y z\n1 2 3\na b c\n1 2 3\n", "line 3: 'a b c' does not have numbers for x, y and z"),
    "the same beginning": ("1 2 3\n1 2 3x\n1 2 3\n", "line 2: '1 2 3x' does not have numbers"),
    "decimal commas, semicolons": ("X;Y;Z\n1,0;2,0;3,0\n", "line 2: .* decimal commas are not read: write 1.5"),
    "decimal commas, no names": ("1,0;2,0;3,0\n4,0;5,0;6,0\n", "line 2: .* decimal commas are not read"),
    "decimal commas, blanks": ("481349,530 3812921,090 26,950\n", "line 1: .* decimal commas are not read"),
    "decimal commas, tabs": ("1,5\t2,5\t3,5\n1,5\t2,5\t3,5\n", "line 2: .* decimal commas are not read"),
    "decimal commas, quotes": ('x,y,z\n"1,0","2,0","3,0"\n', "line 2: .* decimal commas are not read"),
    "decimal commas later": ("x;y;z\n1;2;3\n4;5,5;6\n7;8;9\n", "line 3: .* decimal commas are not read"),
    "decimal commas, commas": ("481349,530,3812921,090,26,950\n", "6 columns .* looks like decimals; .* write 1.5"),
    "decimal commas, commas, names": ("x,y,z\n1,530,2,090,3,950\n", "if the commas are decimal commas, write points"),
    "thousands": ("481,349.53;3,812,921.09;26.95\n", "commas between thousands are not read: write 1234.5"),
    "quoted thousands": ('x,y,z\n"1,481,349","3","26"\n', "line 2: .* commas between thousands"),
    "points between thousands": ("481.349,53;3.812.921,09;26,95\n", "points between thousands are not read"),
    "D exponents": ("1.0D+05 2 3\n", "exponents other than e are not read: write 1.5e3"),
    "D exponents later": ("1 2 3\n1.0D+05 2 3\n1 2 3\n", "line 2: .* exponents other than e are not read"),
    "underscores": ("1_000 2 3\n1 2 3\n", "line 1: .* underscores are not read: write 1234.5"),
    "hexadecimal": ("1 2 3\n0x1p3 2 3\n1 2 3\n", "line 2: .* hexadecimal digits are not read"),
    "zeros within": ("1 2 3\n" + "4 5 6\n" * 20000 + "1 \0 3\n4 5 6\n", r"line 20,002: '1 \\x00 3' does not have"),
    "PTX": (
        "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 .5\n",
        "line 2: a second number stands alone before the first point, as in PTX files, which are not read",
    ),
    "a raster": ("ncols 3\nnrows 2\ncellsize 1\n1 2 3\n", "line 2: 'nrows 2' is no point; expected x y z"),
    "words only": ("hello\n", "line 1: 'hello' is no point, nor does it name x, y and z"),
    "two columns": ("1 2\n", "line 1: '1 2' is no point"),
    "names only": ("x y z\n", "has no points"),
    "a comment only": ("# x y z\n", "has no points"),
    "a count only": ("5\n", "has no points"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_dialects_that_are_refused_with_a_reason(tmp_path: Path, case: str) -> None:
    content, said = REFUSED[case]
    path = written(tmp_path, "a.txt", content)
    with pytest.raises(InvalidInput, match=said) as caught:
        points_of(open_cloud(path))
    message = str(caught.value)
    assert str(path) in message
    assert len(message) < len(str(path)) + 420


@pytest.mark.parametrize("mark", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_wide_encodings_are_refused(tmp_path: Path, mark: str) -> None:
    path = written(tmp_path, "a.txt", "x y z\n1 2 3\n".encode(mark))
    with pytest.raises(FileError, match="UTF-16, which is not read" if mark == "utf-16" else "text file|UTF-16"):
        open_cloud(path)


# name: (content, points, what is said of the damage)
DAMAGED: dict[str, tuple[bytes, int, str]] = {
    "too few for the count": (b"5\n1 2 3\n4 5 6\n", 2, "a.pts announces 5 points in line 1, but 2 follow"),
    "too many for the count": (b"1\n1 2 3\n4 5 6\n", 2, "a.pts announces 1 points in line 1, but 2 follow"),
    "the first of two scans": (b"3\n1 2 3\n1\n4 5 6\n", 2, "a.pts announces 3 points in line 1, but 1 follow"),
    "the second of two scans": (b"1\n1 2 3\n\n3\n4 5 6\n", 2, "a.pts announces 3 points in line 4, but 1 follow"),
    "cut off in the last line": (b"3\n1 2 3\n4 5 6\n7 8", 2, r"last line \('7 8'\); the 2 points .* announces 3"),
    "cut off in the last number": (b"3\n1 2 3\n4 5 6\n7", 2, "announces 3 points in line 1, but 2 follow"),
    "zeros at the end": (b"1 2 3\n4 5 6\n" * 6000 + bytes(99), 12_000, "damaged in its last line"),
    "many zeros at the end": (
        b"1 2 3\n4 5 6\n" * 6000 + bytes(2 * limits.LONGEST_POINT),
        12_000,
        "line 12,001 is longer than 1,048,576 bytes, which no point is; the 12,000 points before it were read",
    ),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_what_is_there_is_read_and_what_is_missing_told(tmp_path: Path, case: str) -> None:
    content, count, said = DAMAGED[case]
    cloud = open_cloud(written(tmp_path, "a.pts", content))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_lines, "BLOCK_BYTES", 1000)
        assert points_of(cloud).tolist() == (TWO * count)[:count]
    assert cloud.damage is not None
    assert len(re.findall(said, cloud.damage)) == 1
    assert write_labelled(cloud, tmp_path / "b.txt", Counted()) == count


def test_a_wrong_count_is_damage_with_all_points_written(tmp_path: Path) -> None:
    path = written(tmp_path, "a.pts", "5\n1 2 3\n4 5 6\n")
    with pytest.warns(StreamsegWarning, match="announces 5 points in line 1, but 2 follow; all that are there were"):
        outcome = ss.segment_file(path, tmp_path / "b.npy", ss.Proximity(9.0))
    assert outcome.points == 2
    assert "announces 5 points" in str(outcome.damage)


@pytest.mark.parametrize("block", [1, 2, 7, 64])
@pytest.mark.parametrize("ends", [b"\n", b"\r\n", b"\r"])
def test_blocks_end_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, ends: bytes) -> None:
    monkeypatch.setattr(text_lines, "BLOCK_BYTES", block)
    lines = [b"\xef\xbb\xbf# id x y z", b"", *(b"%d %d 2 3  # a" % (i, i * i) for i in range(30))]
    cloud = open_cloud(written(tmp_path, "a.txt", ends.join(lines)))
    assert points_of(cloud)[:, 0].tolist() == [i * i for i in range(30)]
    write_labelled(cloud, tmp_path / "b.txt", Counted())
    assert (tmp_path / "b.txt").read_bytes().splitlines()[-1] == b"29 841 2 3 29"
    cloud = open_cloud(written(tmp_path, "a.txt", ends.join([*lines, b"k l m n", b"0 0 0 0"])))
    with pytest.raises(InvalidInput, match="line 33: 'k l m n' does not have numbers"):
        points_of(cloud)


def test_lines_longer_than_any_point_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "a.xyz", b"1 " * 1_000_000)
    with pytest.raises(InvalidInput, match=r"line 1 is longer than 1,048,576 bytes, which no point is"):
        open_cloud(path)
    path = written(tmp_path, "a.xyz", b"1 " * 10_001)
    with pytest.raises(InvalidInput, match=r"has 10,001 columns in a line, allowed: 10,000"):
        open_cloud(path)
    assert len(open_cloud(written(tmp_path, "a.xyz", b"1 " * 10_000)).dimensions) == 10_000


def test_columns_in_degrees_are_told(tmp_path: Path) -> None:
    cloud = open_cloud(written(tmp_path, "a.csv", "height,latitude,longitude\n3,2,1\n6,5,4\n"))
    assert points_of(cloud).tolist() == TWO
    assert cloud.caution is not None
    assert "longitude and latitude in degrees" in cloud.caution
    cloud = open_cloud(written(tmp_path, "b.csv", "x,y,z,lon,lat\n1,2,3,8,50\n4,5,6,8,50\n"))
    assert points_of(cloud).tolist() == TWO
    assert cloud.caution is None


def test_columns_that_may_be_decimals_are_warned_of(tmp_path: Path) -> None:
    path = written(tmp_path, "a.csv", "481349,530,3812921,190,26,950\n481349,540,3812921,190,26,950\n")
    with pytest.warns(StreamsegWarning, match="whole numbers only, .* if the commas are decimal commas, write points"):
        open_cloud(path)


def test_info_says_which_columns_are_x_y_and_z(tmp_path: Path) -> None:
    assert dict(describe(written(tmp_path, "a.txt", "1 2 3\n4 5 6\n")))["columns"] == (
        "x, y and z are columns 1, 2 and 3, which have no names"
    )
    assert dict(describe(written(tmp_path, "a.txt", "# i E N H\n9 1 2 3\n9 4 5 6\n")))["columns"] == (
        "x, y and z are column 2 (E), column 3 (N) and column 4 (H)"
    )
    np.save(tmp_path / "a.npy", np.zeros(2, [("Y", "f4"), ("X", "f4"), ("Z", "f4")]))
    assert dict(describe(tmp_path / "a.npy"))["columns"] == "x, y and z are fields X, Y and Z"


def test_columns_are_reached_by_names_beyond_ascii(tmp_path: Path) -> None:
    path = written(tmp_path, "a.txt", b"x y z h\xf6he\n0 0 0 4\n1 0 0 7\n2 0 0 4\n")
    out = tmp_path / "b.txt"
    ss.segment_file(path, out, ss.Proximity(9.0, filter="höhe < 5"))
    assert out.read_bytes() == b"x y z h\xf6he SegmentID\n0 0 0 4 1\n1 0 0 7 -1\n2 0 0 4 1\n"


def test_a_column_that_holds_no_number_is_named(tmp_path: Path) -> None:
    cloud = open_cloud(written(tmp_path, "a.csv", "x,y,z,n,i\n1,2,3,oak,4\n4,5,6,elm,\n7,8,9,ash,5\n"))
    assert len(points_of(cloud)) == 3
    with pytest.raises(InvalidInput, match=r"line 2: '1,2,3,oak,4' does not have a number for n$"):
        list(cloud.chunks(attributes=["i", "n"]))
    with pytest.raises(InvalidInput, match=r"line 3: '4,5,6,elm,' does not have a number for i$"):
        list(cloud.chunks(attributes=["i"]))


def test_a_name_that_two_columns_have_is_no_attribute(tmp_path: Path) -> None:
    cloud = open_cloud(written(tmp_path, "a.csv", "x,y,z,i,i\n1,2,3,7,8\n4,5,6,7,8\n"))
    assert points_of(cloud).tolist() == TWO
    with pytest.raises(InvalidInput, match="has several columns 'i'"):
        list(cloud.chunks(attributes=["i"]))


def test_files_with_other_columns_do_not_become_one_text_file(tmp_path: Path) -> None:
    first = written(tmp_path, "a.csv", "x,y,z\n1,2,3\n")
    for name, content in {"b.csv": "y,x,z\n5,4,6\n", "c.csv": "x;y;z\n4;5;6\n", "d.csv": "4,5,6,7\n"}.items():
        other = written(tmp_path, name, content)
        assert points_of(open_cloud([first, other])).tolist() == TWO
        with pytest.raises(InvalidInput, match=rf"{name} cannot become one text file: their columns are x, y, z"):
            ss.segment_file([first, other], tmp_path / "out.csv", ss.Proximity(9.0))
        assert not (tmp_path / "out.csv").exists()
        assert ss.segment_file([first, other], tmp_path / f"{name}.npy", ss.Proximity(9.0)).points == 2
    rest = written(tmp_path, "e.csv", "4,5,6\n")
    write_labelled(open_cloud([first, rest]), tmp_path / "out.csv", Counted())
    assert (tmp_path / "out.csv").read_text() == "x,y,z,SegmentID\n1,2,3,0\n4,5,6,1\n"
