"""How the lines of a text file are put together: what separates columns, how many there are, what they are called."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..errors import FileError, InvalidInput, warn
from .axes import Axes
from .limits import MOST_COLUMNS
from .opening import reading
from .text_lines import BOM, without_comments
from .text_names import Names, find_names, require_names
from .text_numbers import has_split_decimals, may_have_split_decimals, split
from .text_preamble import Preamble, delimiter_in, read_preamble

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_SNIFFED_BYTES = 1 << 16
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


class TextLayout(NamedTuple):
    """How the lines of a file are put together.

    delimiter : the character between columns; None for any run of blanks and tabs
    joiner : what to put between the last column and one that is appended
    ends_in_delimiter : whether lines end in a delimiter that has no column behind it
    has_bom : whether the file starts with the mark of UTF-8
    skipped : lines in front of the first point
    announced : line number and value of the number of points, if the file announces it
    header : the line that names the columns, without its line end; None when there is none
    header_joiner : what to put between the last name and one that is appended
    names : one per column
    axes : where x, y and z are
    """

    delimiter: str | None
    joiner: str
    ends_in_delimiter: bool
    has_bom: bool
    skipped: int
    announced: tuple[int, int] | None
    header: str | None
    header_joiner: str
    names: tuple[str, ...]
    axes: Axes

    @property
    def xyz(self) -> tuple[int, int, int]:
        """Index of the columns x, y and z."""
        return self.axes.places or (0, 1, 2)


def read_layout(path: Path) -> tuple[TextLayout, bool]:
    """Find out how a file is put together, and whether it has no points.

    Raises
    ------
    FileError
        It cannot be read, or is no text.
    InvalidInput
        It does not begin like a list of points, or its names do not say where x, y and z are.
    """
    with reading(path) as file:
        start = file.read(_SNIFFED_BYTES)
        _require_text(path, start)
        file.seek(0)
        preamble = read_preamble(file, path)
    has_bom = start.startswith(BOM)
    if not preamble.points:
        if preamble.plain is not None:
            require_names(path, preamble.plain)
        return _without_points(preamble, has_bom), True
    lines = [without_comments(point.text).rstrip(" ") for point in preamble.points]
    delimiter = _delimiter(lines, preamble)
    width = len(split(lines[0], delimiter))
    _require_columns(path, width)
    may_end = delimiter is not None and all(line.endswith(delimiter) for line in lines)
    names = find_names(path, preamble, delimiter, (width, width - 1) if may_end else (width,))
    ends_in_delimiter = may_end and (names is None or len(names.words) < width)
    if names is None:
        names = _by_place(path, lines, delimiter, width - ends_in_delimiter)
    joiner = delimiter or ("\t" if "\t" in lines[0] else " ")
    skipped = preamble.points[0].number - 1
    return TextLayout(
        delimiter, joiner, ends_in_delimiter, has_bom, skipped, preamble.count, *_named(names, joiner)
    ), False


def _named(names: Names, joiner: str) -> tuple[str | None, str, tuple[str, ...], Axes]:
    return (names.header or None, names.joiner or joiner, names.words, names.axes)


def _without_points(preamble: Preamble, has_bom: bool) -> TextLayout:
    names = ("x", "y", "z")
    return TextLayout(None, " ", False, has_bom, 0, preamble.count, None, " ", names, Axes((0, 1, 2)))


def _require_text(path: Path, start: bytes) -> None:
    if start.startswith(_UTF_16):
        raise FileError(f"{path} is written in UTF-16, which is not read; save it as UTF-8 or plain text")
    if b"\0" in start:
        raise FileError(f"{path} is no text file, though its name ends in {path.suffix}")
    if not start.strip() and len(start) < _SNIFFED_BYTES:
        raise FileError(f"{path} is empty, lines of x y z were expected")


def _require_columns(path: Path, width: int) -> None:
    if width > MOST_COLUMNS:
        raise InvalidInput(f"{path} has {width:,} columns in a line, allowed: {MOST_COLUMNS:,}")


def _delimiter(lines: Sequence[str], preamble: Preamble) -> str | None:
    """Tell what separates columns; a tab does where it stands alone, so that columns may be empty or hold blanks."""
    mark = delimiter_in(lines[0])
    if mark is not None or "\t" not in lines[0].strip():
        return mark
    parts = [part.strip(" ") for part in lines[0].split("\t")]
    before = [*preamble.comments, *([preamble.plain] if preamble.plain else [])]
    is_named = any(line.text.count("\t") == len(parts) - 1 for line in before)
    are_whole = all(parts) and not any(" " in part for part in parts[:3])
    is_everywhere = len({line.count("\t") for line in lines if line.strip()}) == 1
    return "\t" if len(parts) >= 3 and (is_named or are_whole) and is_everywhere else None


def _by_place(path: Path, lines: Sequence[str], delimiter: str | None, width: int) -> Names:
    """Take the first three columns as x, y and z, unless they are halves of numbers."""
    if width < 3:
        raise InvalidInput(f"{path} has {width} columns, expected x, y and z")
    if delimiter == "," and has_split_decimals(lines):
        raise InvalidInput(
            f"{path} has {width} columns between commas, and every second looks like decimals; "
            "if they are, write 1.5, else name the columns in a first line"
        )
    if delimiter == "," and may_have_split_decimals(lines):
        warn(
            f"{path} holds whole numbers only, of which the first three of each line are taken as x, y and z; "
            "if the commas are decimal commas, write points for them"
        )
    words = ("x", "y", "z", *(f"column_{place}" for place in range(4, width + 1)))
    return Names("", "", words, Axes((0, 1, 2)))
