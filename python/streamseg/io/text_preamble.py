"""What stands before the first point of a text file: comments, a line of names, the number of points."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from ..errors import InvalidInput
from .text_lines import LineTooLong, blocks, to_bytes, without_comments
from .text_numbers import hint, is_number, is_value, split

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_SAMPLED_LINES = 100
_COMMENTS_KEPT = 100
_LONGEST_COMMENT = 1 << 17
_LONGEST_LINE_SHOWN = 60


class Line(NamedTuple):
    """A line and its number, from 1."""

    number: int
    text: str


@dataclass
class Preamble:
    """What stands before the first point.

    plain : a line without a mark that is no point: names, it must be
    comments : the last lines behind ``#`` or ``//``
    count : the line of the number of points, and the number
    points : the first lines of points
    """

    plain: Line | None = None
    comments: deque[Line] = field(default_factory=lambda: deque(maxlen=_COMMENTS_KEPT))
    count: tuple[int, int] | None = None
    points: list[Line] = field(default_factory=list)


def read_preamble(file: BinaryIO, path: Path) -> Preamble:
    """Read up to the first point, and some lines beyond.

    Raises
    ------
    InvalidInput
        More than comments, a line of names and a number of points stands there.
    """
    found = Preamble()
    lines = _lines(file)
    try:
        for line in lines:
            if not _is_comment(line.text) and is_point(without_comments(line.text)):
                more = (each for each in islice(lines, _SAMPLED_LINES) if not _is_comment(each.text))
                found.points = [line, *more]
                break
            _note(path, found, line)
    except LineTooLong as error:
        if not found.points:
            raise InvalidInput(f"{path} {error}") from None
    return found


def delimiter_in(line: str) -> str | None:
    """Tell what stands between the columns; None for blanks and tabs."""
    return next((mark for mark in ";," if mark in line), None)


def is_point(line: str) -> bool:
    """Tell whether it holds numbers enough for a point."""
    parts = split(line.strip(), delimiter_in(line))
    if len(parts) >= 3 and all(map(is_value, parts[:3])):
        return True
    # A name in front of the coordinates is fine when a line of names says where they are.
    return len(parts) > 3 and sum(map(is_number, parts)) >= 3


def readable(text: str) -> str:
    """Decode what people wrote: UTF-8, or else Latin-1."""
    data = to_bytes(text)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def shown(line: str) -> str:
    """Quote a line, but not all of a long one."""
    line = readable(line.strip())
    return repr(line if len(line) <= _LONGEST_LINE_SHOWN else line[:_LONGEST_LINE_SHOWN] + "…")


def _lines(file: BinaryIO) -> Iterator[Line]:
    for block in blocks(file):
        for number, text in enumerate(block.text.split("\n"), block.first):
            if text.strip(" \t\f\v,;"):
                yield Line(number, text)


def _is_comment(text: str) -> bool:
    return text.lstrip().startswith(("#", "//"))


def _note(path: Path, found: Preamble, line: Line) -> None:
    text = line.text.strip()
    if _is_comment(text):
        if len(text) <= _LONGEST_COMMENT:
            found.comments.append(line)
    elif re.fullmatch(r"\d{1,18}", text, re.ASCII):
        if found.count is not None and found.count[1] > 0:
            raise InvalidInput(
                f"{path} line {line.number:,}: a second number stands alone before the first point, as in PTX files, "
                "which are not read; export the points as XYZ or PTS"
            )
        found.count = (line.number, int(text))
    elif found.plain is None:
        found.plain = line
    else:
        raise InvalidInput(
            f"{path} line {line.number:,}: {shown(text)} is no point; expected x y z separated by comma, semicolon, "
            f"tab or blank, after at most one line of names{hint(text)}"
        )
