"""Text files of points as sources: x, y and z in columns, one point a line, parsed by NumPy's C reader."""

from __future__ import annotations

import re
from itertools import islice
from typing import IO, TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import FileError, InvalidInput
from .cloud import Chunk
from .lattice import Lattice

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

SUFFIXES = (".xyz", ".txt", ".csv", ".pts", ".asc")

_SNIFFED_BYTES = 1 << 16
_LINES_AT_ONCE = 200_000
_LONGEST_LINE_SHOWN = 60

# What the columns of x, y and z are called, whatever their case; where several are there, the first of these.
_NAMES = (
    ("x", "easting", "east", "e"),
    ("y", "northing", "north", "n"),
    ("z", "height", "elevation", "altitude", "h"),
)


class TextLayout(NamedTuple):
    """How the lines of a file are put together.

    delimiter : the character between columns; None for any run of blanks and tabs
    joiner : what to put between the last column and one that is appended
    skipped : lines in front of the first point
    header : the line that names the columns, without its line end; None when there is none
    names : one per column
    xyz : index of the columns x, y and z
    """

    delimiter: str | None
    joiner: str
    skipped: int
    header: str | None
    names: tuple[str, ...]
    xyz: tuple[int, int, int]


class TextSource:
    """One text file. See `streamseg.io.cloud.Source`.

    Columns are separated by commas, semicolons, tabs or blanks. A first line of names says which columns are x (or
    easting), y (or northing) and z (or height, elevation); without one they are the first three columns. ``#`` starts
    a comment. In a ``.pts`` file the first line is the number of points.
    """

    kind = "text"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lattice = Lattice()
        self.damage: str | None = None
        self.layout, is_empty = _sniff(path)
        self.point_count: int | None = 0 if is_empty else None
        self.dimensions = self.layout.names

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield the points as float64; attributes are float64 too."""
        for lines, table in self._parsed(size, [self.layout.names.index(name) for name in attributes]):
            del lines
            points = np.ascontiguousarray(table[:, :3])
            others = {name: np.ascontiguousarray(table[:, 3 + i]) for i, name in enumerate(attributes)}
            yield Chunk(points, others)

    def lines(self, size: int) -> Iterator[tuple[list[str], NDArray[np.float64]]]:
        """Yield the lines that hold points, without their ends, and these points, in the order of `chunks`."""
        yield from self._parsed(size, [])

    def _parsed(self, size: int, others: list[int]) -> Generator[tuple[list[str], NDArray[np.float64]], None, None]:
        self.damage = None
        columns = [*self.layout.xyz, *others]
        done, at = 0, self.layout.skipped
        with open_text(self.path) as file:
            for _ in islice(file, self.layout.skipped):
                pass
            while raw := list(islice(file, min(size, _LINES_AT_ONCE))):
                lines = [line for text in raw if (line := text.partition("#")[0].rstrip())]
                try:
                    table = self._parse(lines, columns)
                except ValueError:
                    good = self._count_parsable(lines, columns)
                    ends_here = good == len(lines) - 1 and next(file, None) is None
                    self._explain(raw, lines[good], at, done + good, ends_here)
                    lines = lines[:good]
                    table = self._parse(lines, columns)
                if lines:
                    yield lines, table
                at += len(raw)
                done += len(lines)

    def _parse(self, lines: list[str], columns: list[int]) -> NDArray[np.float64]:
        if not lines:
            return np.empty((0, len(columns)))
        return np.loadtxt(lines, np.float64, comments=None, delimiter=self.layout.delimiter, usecols=columns, ndmin=2)

    def _count_parsable(self, lines: list[str], columns: list[int]) -> int:
        """How many lines in front of the first that does not parse, by bisection."""
        good, bad = 0, len(lines)
        while good < bad - 1:
            probe = (good + bad) // 2
            try:
                self._parse(lines[good:probe], columns)
                good = probe
            except ValueError:
                bad = probe
        return good

    def _explain(self, raw: list[str], line: str, at: int, done: int, is_last: bool) -> None:
        shown = line if len(line) <= _LONGEST_LINE_SHOWN else line[:_LONGEST_LINE_SHOWN] + "…"
        if is_last and done > 0:
            self.damage = (
                f"{self.path.name} is damaged in its last line ({shown!r}); the {done:,} points before it were read"
            )
            return
        number = at + 1 + next(i for i, text in enumerate(raw) if text.startswith(line))
        raise InvalidInput(f"{self.path} line {number:,}: {shown!r} does not have numbers for x, y and z")


def open_text(path: Path) -> IO[str]:
    """Open a text file so that its lines come back as they are, odd bytes included."""
    return open(path, encoding="utf-8-sig", errors="surrogateescape", newline="")


def _sniff(path: Path) -> tuple[TextLayout, bool]:
    with open(path, "rb") as file:
        start = file.read(_SNIFFED_BYTES)
    if not start.strip():
        raise FileError(f"{path} is empty, lines of x y z were expected")
    if b"\0" in start:
        raise FileError(f"{path} is no text file, though its name ends in {path.suffix}")
    skipped, header, line = 0, None, None
    with open_text(path) as file:
        for text in file:
            content = text.strip()
            if content and not content.startswith("#"):
                if _is_point(content):
                    line = content
                    break
                if header is None and not (path.suffix.lower() == ".pts" and content.isdigit()):
                    header = text.rstrip("\r\n")
                elif header is not None:
                    raise InvalidInput(
                        f"{path} line {skipped + 1}: {content[:_LONGEST_LINE_SHOWN]!r} is no point; "
                        "expected x y z separated by comma, semicolon, tab or blank, after at most one line of names"
                    )
            skipped += 1
    delimiter = _delimiter(line if line is not None else header or "")
    joiner = delimiter or ("\t" if "\t" in (line or "") else " ")
    names, xyz = _columns(path, header, line, delimiter)
    return TextLayout(delimiter, joiner, skipped, header, names, xyz), line is None


def _delimiter(line: str) -> str | None:
    return next((mark for mark in ";," if mark in line), None)


def _split(line: str, delimiter: str | None) -> list[str]:
    return [part.strip() for part in line.split(delimiter)]


def _is_point(line: str) -> bool:
    parts = _split(line, _delimiter(line))
    try:
        return len([float(part) for part in parts[:3]]) == 3
    except ValueError:
        # A name in front of the coordinates is fine when a header says where they are.
        return len(parts) > 3 and sum(_is_number(part) for part in parts) >= 3


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text) is not None


def _columns(
    path: Path, header: str | None, line: str | None, delimiter: str | None
) -> tuple[tuple[str, ...], tuple[int, int, int]]:
    width = len(_split(line, delimiter)) if line is not None else 3
    default = ("x", "y", "z", *(f"column_{i}" for i in range(4, width + 1)))
    if header is None:
        return default, (0, 1, 2)
    names = [name.strip("\"'") for name in _split(header.lstrip().removeprefix("//"), delimiter)]
    lower = [name.lower() for name in names]
    found = [next((lower.index(name) for name in axis if name in lower), None) for axis in _NAMES]
    x, y, z = found
    if x is not None and y is not None and z is not None:
        return tuple(names), (x, y, z)
    if len(names) == width:
        missing = [axis[0] for axis, place in zip(_NAMES, found, strict=True) if place is None]
        raise InvalidInput(
            f"{path} names its columns {', '.join(names)}; which of them is {' and '.join(missing)} is not clear: "
            f"name the columns x, y and z (or easting, northing and height), or remove the line of names to have the "
            "first three columns taken"
        )
    return default, (0, 1, 2)
