"""Text files of points as sources: x, y and z in columns, one point a line, parsed by NumPy's C reader."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput
from .axes import listed
from .cloud import Chunk
from .coordinate_system import LONGITUDE_LATITUDE
from .lattice import Lattice
from .opening import reading
from .text_layout import TextLayout, read_layout
from .text_lines import LineTooLong, Rows, blocks, rows_of
from .text_numbers import hint, is_value, split
from .text_preamble import shown

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from .text_lines import Block

SUFFIXES = (".xyz", ".txt", ".csv", ".pts", ".asc")

__all__ = ["SUFFIXES", "TextLayout", "TextSource"]


class TextSource:
    """One text file. See `streamseg.io.cloud.Source`.

    Columns are separated by commas, semicolons, tabs or blanks. A line of names before the points says which columns
    are x (or easting), y (or northing) and z (or height, elevation). It may stand behind ``#`` or ``//``. Without one
    they are the first three columns. Every line has the same columns. ``#`` starts a comment. A number alone in a line
    before the points announces how many follow.

    Attributes
    ----------
    coordinate_system : CoordinateSystem or None
        What the names of x and y say of it.
    columns_said : str
        Which columns are x, y and z, for people.
    """

    kind = "text"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lattice = Lattice()
        self.damage: str | None = None
        self.layout, is_empty = read_layout(path)
        self.point_count: int | None = 0 if is_empty else None
        self.dimensions = self.layout.names
        self.coordinate_system = LONGITUDE_LATITUDE if self.layout.axes.in_degrees else None
        self.columns_said = _columns_said(self.layout)

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield the points as float64; attributes are float64 too."""
        twins = [name for name in attributes if self.layout.names.count(name) > 1]
        if twins:
            raise InvalidInput(f"{self.path} has several columns {twins[0]!r}; give each a name of its own")
        for _, table in self._parsed(size, [self.layout.names.index(name) for name in attributes]):
            points = np.ascontiguousarray(table[:, :3])
            others = {name: np.ascontiguousarray(table[:, 3 + i]) for i, name in enumerate(attributes)}
            yield Chunk(points, others)

    def lines(self, size: int) -> Generator[tuple[list[str], NDArray[np.float64]], None, None]:
        """Yield the lines that hold points, without their ends, and these points, in the order of `chunks`."""
        yield from self._parsed(size, [])

    def _parsed(self, size: int, others: list[int]) -> Generator[tuple[list[str], NDArray[np.float64]], None, None]:
        self.damage = None
        columns = [*self.layout.xyz, *others]
        scans = _Scans(self.layout.announced)
        done = 0
        with reading(self.path) as file:
            try:
                for block in blocks(file):
                    rows = scans.without_counts(self._rows(block), done)
                    lines, table = self._sound(rows, columns, done, block.is_last)
                    for start in range(0, len(lines), size):
                        yield lines[start : start + size], table[start : start + size]
                    done += len(lines)
            except LineTooLong as error:
                if done == 0:
                    raise InvalidInput(f"{self.path} {error}") from None
                self._note(f"{self.path.name} is damaged: {error}; the {done:,} points before it were read")
        if said := scans.mistake(done):
            self._note(f"{self.path.name} {said}")

    def _rows(self, block: Block) -> Rows:
        rows = rows_of(block, self.layout.delimiter, self.layout.ends_in_delimiter)
        return rows.where(rows.numbers > self.layout.skipped) if block.first <= self.layout.skipped else rows

    def _sound(self, rows: Rows, columns: list[int], done: int, is_last: bool) -> tuple[list[str], NDArray[np.float64]]:
        """Parse the rows; all of them, or those before a last line that is cut off."""
        odd = np.flatnonzero(rows.widths != len(self.layout.names))
        sound = int(odd[0]) if len(odd) else len(rows.lines)
        try:
            table = self._parse(rows.values[:sound], columns)
        except ValueError:
            sound = self._count_parsable(rows.values[:sound], columns)
            table = self._parse(rows.values[:sound], columns)
        if sound < len(rows.lines):
            self._explain(rows, sound, columns, done, is_last and sound == len(rows.lines) - 1)
        return rows.lines[:sound], table

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

    def _explain(self, rows: Rows, place: int, columns: list[int], done: int, is_last: bool) -> None:
        """Tell what is the matter with a line."""
        line, width, due = rows.lines[place], int(rows.widths[place]), len(self.layout.names)
        if is_last and width <= due and done + place > 0:
            self._note(
                f"{self.path.name} is damaged in its last line ({shown(line)}); "
                f"the {done + place:,} points before it were read"
            )
            return
        where = f"{self.path} line {rows.numbers[place]:,}: {shown(line)}"
        if width != due:
            raise InvalidInput(
                f"{where} has {width:,} column{'s' * (width != 1)}, the first point, in line "
                f"{self.layout.skipped + 1:,}, has {due:,}; every line needs the same columns{hint(line)}"
            )
        parts = split(line, self.layout.delimiter)
        odd = next((column for column in columns[3:] if not is_value(parts[column])), None)
        if odd is not None and all(is_value(parts[column]) for column in columns[:3]):
            raise InvalidInput(
                f"{where} does not have a number for {listed(self.layout.names[odd : odd + 1])}{hint(line)}"
            )
        raise InvalidInput(f"{where} does not have numbers for x, y and z{hint(line)}")

    def _note(self, damage: str) -> None:
        self.damage = damage if self.damage is None else f"{self.damage}; {damage}"


class _Scans:
    """The numbers of points that a file announces, one in front of each of its scans, against what follows."""

    def __init__(self, first: tuple[int, int] | None) -> None:
        self._announced = first
        self._start = 0
        self._mistake = ""

    def without_counts(self, rows: Rows, done: int) -> Rows:
        """Take note of lines that announce a number of points, and leave them out."""
        if self._announced is None:
            return rows
        is_count = np.zeros(len(rows.lines), np.bool_)
        counts = 0
        for place in np.flatnonzero(rows.widths == 1).tolist():
            line = rows.lines[place].strip()
            if line.isdecimal() and len(line) <= 18:
                self._end(done + place - counts)
                self._announced = (int(rows.numbers[place]), int(line))
                is_count[place] = True
                counts += 1
        return rows.where(~is_count)

    def mistake(self, done: int) -> str:
        """Say, at the end, which number is wrong; empty if none is."""
        self._end(done)
        return self._mistake

    def _end(self, done: int) -> None:
        if self._announced is not None and not self._mistake:
            line, count = self._announced
            if done - self._start != count:
                self._mistake = f"announces {count:,} points in line {line:,}, but {done - self._start:,} follow; "
                self._mistake += "all that are there were read"
        self._start = done


def _columns_said(layout: TextLayout) -> str:
    if layout.header is None:
        return "x, y and z are columns 1, 2 and 3, which have no names"
    named = [f"column {place + 1} ({layout.names[place]})" for place in layout.xyz]
    return f"x, y and z are {named[0]}, {named[1]} and {named[2]}"
