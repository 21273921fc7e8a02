"""The line of names of a text file: which of the lines before the points it is, and where it says x, y and z are."""

from __future__ import annotations

import re
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

from ..errors import InvalidInput
from .axes import ALLOWED, Axes, axes_of, listed
from .text_numbers import hint, is_number
from .text_preamble import Line, readable, shown

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from .text_preamble import Preamble

# What a column is called, as against the words and marks of a sentence.
_NAME = re.compile(r"[^\W\d]([^\s,;:!?]*[^\s,;:!?.])?")

# On the average of a line.
_LONGEST_NAME = 100

# A comment that says where x, y and z are, and has this many words more or less than there are columns, is no prose.
_WORDS_AMISS = 2


class Names(NamedTuple):
    """A line of names.

    header : the line as it stands
    joiner : what stands between its words
    words : one per column
    axes : where x, y and z are
    """

    header: str
    joiner: str
    words: tuple[str, ...]
    axes: Axes


def require_names(path: Path, line: Line) -> None:
    """Refuse a line that no points follow, unless it names x, y and z.

    Raises
    ------
    InvalidInput
        It is no line of names.
    """
    words = (_words(line.text, separator) for separator in (",", ";", "\t", None))
    if not any(axes_of(each).places for each in words):
        raise InvalidInput(
            f"{path} line {line.number:,}: {shown(line.text)} is no point, nor does it name x, y and z{hint(line.text)}"
        )


def find_names(path: Path, preamble: Preamble, delimiter: str | None, widths: Sequence[int]) -> Names | None:
    """Find the line of names.

    Parameters
    ----------
    path : Path
    preamble : Preamble
    delimiter : str, optional
        What stands between columns.
    widths : sequence of int
        How many columns there may be; the first that fits counts.

    Returns
    -------
    Names or None
        None if there is none: then columns are known by their places.

    Raises
    ------
    InvalidInput
        Something that must be a line of names does not have one per column, or does not say where x, y and z are.
    """
    if preamble.plain is not None:
        return _plain(path, preamble.plain, preamble.points[0], delimiter, widths)
    fitting = [(line, _fitting(line, delimiter, widths)) for line in reversed(preamble.comments)]
    for _, names in fitting:
        if names is not None and names.axes.places is not None:
            return names
    for line, names in fitting:
        is_header = names is not None and (
            names.axes.twins or (line is preamble.comments[-1] and all(map(_NAME.fullmatch, names.words)))
        )
        if names is not None and is_header:
            raise InvalidInput(_unclear(path, names))
        if names is None and _says_other_axes(line, widths):
            raise InvalidInput(
                f"{path} line {line.number:,}: {shown(line.text)} says where x, y and z are, but has "
                f"not one name for each of the {widths[-1]} columns; correct the line, or remove it "
                "to have the first three columns taken"
            )
    return None


def _plain(path: Path, line: Line, point: Line, delimiter: str | None, widths: Sequence[int]) -> Names:
    names = _fitting(line, delimiter, widths)
    if foreign := hint(line.text):
        raise InvalidInput(f"{path} line {line.number:,}: {shown(line.text)} is no point{foreign}")
    if names is None:
        raise InvalidInput(
            f"{path} line {line.number:,}: {shown(line.text)} is no point, and does not have one name for each of the "
            f"{widths[-1]} columns of line {point.number:,}; give every column a name, or put # in front of a comment"
            f"{hint(point.text) or _hint_of_halves(line, delimiter, widths)}"
        )
    if names.axes.places is None:
        raise InvalidInput(_unclear(path, names))
    return names


def _hint_of_halves(line: Line, delimiter: str | None, widths: Sequence[int]) -> str:
    is_half = delimiter == "," and 2 * len(_words(line.text, ",")) in widths
    return "; if the commas are decimal commas, write points for them" if is_half else ""


def _unclear(path: Path, names: Names) -> str:
    return (
        f"{path} names its columns {listed(names.words)}; {names.axes.problem()}: name the columns {ALLOWED}, "
        "or remove the line of names to have the first three columns taken"
    )


def _fitting(line: Line, delimiter: str | None, widths: Sequence[int]) -> Names | None:
    """Take the line as names, if it has one per column."""
    fitting: list[Names] = []
    if len(line.text) > _LONGEST_NAME * (max(widths) + 1):
        return None
    for text, width, separator in product(_texts(line), widths, dict.fromkeys((delimiter, "\t", ",", ";", None))):
        words = _words(text, separator)
        if len(words) == width and all(words) and not all(map(is_number, words)):
            joiner = separator or ("\t" if "\t" in text else " ")
            fitting.append(Names(line.text.rstrip(), joiner, tuple(words), axes_of(words)))
    # "id, x, y, z" has four words between blanks as well, of which the first three end in commas.
    return next((names for names in fitting if names.axes.places is not None), fitting[0] if fitting else None)


def _texts(line: Line) -> list[str]:
    """Return what can be names: behind the mark of a comment, and behind a colon there: ``# columns: x y z``."""
    text = line.text.strip()
    bare = re.sub(r"^(#+|//+)", "", text).strip()
    return [bare] if bare == text or ":" not in bare else [bare, bare.rpartition(":")[2].strip()]


def _words(text: str, separator: str | None) -> list[str]:
    if '"' in text:
        word = r'("[^"]*"|\S+)' if separator is None else rf'(?:^|{separator})((?:"[^"]*"|[^{separator}])*)'
        parts = re.findall(word, text)
    else:
        parts = text.split(separator)
    words = [readable(part).strip().strip("\"'") for part in parts]
    # A delimiter at the end has no name behind it.
    return words[:-1] if words and not words[-1] else words


def _says_other_axes(line: Line, widths: Sequence[int]) -> bool:
    """Tell whether a comment that fits no columns says that x, y and z are not the first three."""
    for text in _texts(line):
        words = re.split(r"[,;\s]+", readable(text).strip(",; "))
        if any(map(is_number, words)) or min(abs(len(words) - width) for width in widths) > _WORDS_AMISS:
            continue
        if any(axes_of(words[-width:]).places == (0, 1, 2) for width in widths):
            continue  # a sentence that ends in x y z
        axes = axes_of(words)
        if axes.twins or (axes.places is not None and axes.places != (0, 1, 2)):
            return True
    return False
