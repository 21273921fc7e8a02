"""Text files in blocks of whole lines, bounded in bytes, and what such a block holds.

Bytes beyond ASCII are kept as they are, each as one surrogate character: no encoding is assumed, none of them counts
as a blank, and what is written again is what was read.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np

from ..errors import InvalidInput
from .limits import BLOCK_BYTES, LONGEST_POINT
from .text_numbers import unquoted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

BOM = b"\xef\xbb\xbf"

# A comment starts a line or follows a blank: "1.#IND" and "tree#4" are values.
_COMMENT = re.compile(r"(?:^|(?<=[ \t]))#[^\n]*", re.MULTILINE)

_IS_BLANK = np.array([chr(code).isspace() and code < 128 for code in range(256)])


class LineTooLong(InvalidInput):
    """A line is longer than any point."""

    def __init__(self, number: int) -> None:
        super().__init__(f"line {number:,} is longer than {LONGEST_POINT:,} bytes, which no point is")


class Block(NamedTuple):
    """Consecutive whole lines.

    text : the lines, each ended by a newline, but perhaps the file's last
    first : number of the first line, from 1
    is_last : whether the file ends here
    """

    text: str
    first: int
    is_last: bool


class Rows(NamedTuple):
    """The lines of a block that hold something.

    lines : without comments, and blanks at the end
    values : the same without quotes
    widths : number of columns of each
    numbers : number of each line in the file
    """

    lines: list[str]
    values: list[str]
    widths: NDArray[np.int64]
    numbers: NDArray[np.int64]

    def where(self, kept: NDArray[np.bool_]) -> Rows:
        """Return some of the rows."""
        if kept.all():
            return self
        places = np.flatnonzero(kept).tolist()
        lines = [self.lines[place] for place in places]
        values = lines if self.values is self.lines else [self.values[place] for place in places]
        return Rows(lines, values, self.widths[kept], self.numbers[kept])


def to_text(data: bytes) -> str:
    """Make text of bytes, one character each."""
    return data.decode("ascii", "surrogateescape")


def to_bytes(text: str) -> bytes:
    """Make of the text the bytes that it was."""
    return text.encode("ascii", "surrogateescape")


def blocks(file: BinaryIO) -> Iterator[Block]:
    """Yield a file in blocks of whole lines; lines end in LF, CR LF or CR.

    Raises
    ------
    LineTooLong
        After everything that stands before the line.
    """
    number, rest = 1, b""
    ahead = file.read(len(BOM)).removeprefix(BOM) + file.read(BLOCK_BYTES)
    while ahead:
        data = rest + ahead
        ahead = file.read(BLOCK_BYTES)
        end = _end_of_whole_lines(data) if ahead else len(data)
        rest = data[end:]
        text = to_text(data[:end]).replace("\r\n", "\n").replace("\r", "\n")
        lengths = _lengths(text)
        if (lengths > LONGEST_POINT).any() or len(rest) > LONGEST_POINT:
            sound = int(np.argmax(lengths > LONGEST_POINT)) if (lengths > LONGEST_POINT).any() else len(lengths)
            if sound:
                yield Block(text[: int(lengths[:sound].sum())], number, False)
            raise LineTooLong(number + sound)
        if text:
            yield Block(text, number, not ahead)
        number += len(lengths)


def rows_of(block: Block, delimiter: str | None, ends_in_delimiter: bool) -> Rows:
    """Take a block apart.

    Parameters
    ----------
    block : Block
    delimiter : str, optional
        The character between columns; None for any run of blanks and tabs.
    ends_in_delimiter : bool
        Whether a delimiter at the end of a line has no column behind it.
    """
    text = without_comments(block.text)
    if ends_in_delimiter and delimiter is not None:
        text = re.sub(rf"{delimiter} *$", "", text, flags=re.MULTILINE)
    bare = unquoted(text)
    lines = _lines(text, delimiter)
    values = lines if bare is text else _lines(bare, delimiter)
    rows = Rows(lines, values, _widths(bare, delimiter), np.arange(block.first, block.first + len(lines)))
    return rows.where(rows.widths > 0)


def without_comments(text: str) -> str:
    """Take comments away; the lines stay."""
    return _COMMENT.sub("", text) if "#" in text else text


def _lines(text: str, delimiter: str | None) -> list[str]:
    # A tab at the end has an empty column behind it, where tabs separate columns.
    blanks = " " if delimiter == "\t" else None
    lines = [line.rstrip(blanks) for line in text.split("\n")]
    return lines[:-1] if text.endswith("\n") else lines


def _end_of_whole_lines(data: bytes) -> int:
    # The LF of a CR at the very end may follow.
    return max(data.rfind(b"\n"), data.rfind(b"\r", 0, len(data) - 1)) + 1


def _starts(codes: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Tell where lines start; the end of the last newline is no start."""
    starts = np.concatenate(([0], np.flatnonzero(codes == ord("\n")) + 1))
    return starts[starts < len(codes)]


def _lengths(text: str) -> NDArray[np.int64]:
    """Tell how long lines are, with their ends."""
    return np.diff(_starts(np.frombuffer(to_bytes(text), np.uint8)), append=len(text))


def _widths(text: str, delimiter: str | None) -> NDArray[np.int64]:
    """Count the columns of each line; 0 where nothing but blanks and delimiters is."""
    codes = np.frombuffer(to_bytes(text), np.uint8)
    starts = _starts(codes)
    if not len(starts):
        return np.empty(0, np.int64)
    is_content = ~_IS_BLANK[codes]
    if delimiter is None:
        is_content[1:] &= _IS_BLANK[codes[:-1]]
        return np.add.reduceat(is_content, starts, dtype=np.int64)
    is_delimiter = codes == ord(delimiter)
    has_content = np.logical_or.reduceat(is_content & ~is_delimiter, starts)
    return np.where(has_content, np.add.reduceat(is_delimiter, starts, dtype=np.int64) + 1, 0)
