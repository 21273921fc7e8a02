"""Whether a file is an earlier output of streamseg, which may be replaced, or somebody's work, which may not.

LAS and LAZ bear a sign: the description of the dimension that holds the ids. An ``.npy`` of ids is one row of
whole numbers. Text bears a sign only where it has a line of names; else its lines have one column more than those
of the input, and a whole number in it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from ..errors import StreamsegError
from .labels import LAS_SIGN, SEGMENT_DIMENSION
from .text import SUFFIXES as TEXT_SUFFIXES
from .text import TextLayout, TextSource

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_LAS_SUFFIXES = (".las", ".laz")
_LAS_MAGIC, _NPY_MAGIC, _PNG_MAGIC = b"LASF", b"\x93NUMPY", b"\x89PNG\r\n\x1a\n"
_LAS_POINTS_AT = 96
_MOST_HEADER = 1 << 24
_NPY_OF_IDS = (rb"'descr': '[<|>=]?i\d'", rb"'shape': \(\d+,\)")
_MOST_NPY_HEADER = 1 << 10
_COLUMNS_OF_COORDINATES = 3


def foreign(out: Path, inputs: Sequence[Path]) -> str | None:
    """Say what a file is that streamseg has not written; None if it may be replaced.

    What has no content, or is not what its suffix says, is nobody's cloud and may be replaced; but any text may be
    somebody's.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    suffix = out.suffix.lower()
    if out.stat().st_size == 0:
        return None
    if suffix in TEXT_SUFFIXES:
        is_ours = _is_our_text(out, inputs)
        return None if is_ours else "a text that streamseg has not written"
    with open(out, "rb") as file:
        head = file.read(_MOST_NPY_HEADER)
    if suffix == ".npy":
        is_ours = not head.startswith(_NPY_MAGIC) or all(re.search(sign, head) for sign in _NPY_OF_IDS)
        return None if is_ours else "an array that streamseg has not written"
    is_ours = not head.startswith(_LAS_MAGIC) or _has_sign(out)
    return None if is_ours else "a cloud that streamseg has not written"


def no_picture(out: Path) -> str | None:
    """Say that a file is no picture; None if it is, or has no content, and may be replaced."""
    with open(out, "rb") as file:
        return None if file.read(len(_PNG_MAGIC)) in (_PNG_MAGIC, b"") else "no picture"


def is_like_inputs(out: Path, inputs: Sequence[Path]) -> bool:
    """Whether a labelled cloud looks like one more of the inputs: several labelled ones beside it."""
    return len(inputs) > 1 and all(
        path.suffix.lower() == out.suffix.lower()
        and path.resolve().parent == out.resolve().parent
        and _is_labelled(path)
        for path in inputs
    )


def _is_labelled(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix in _LAS_SUFFIXES:
        return path.is_file() and _has_sign(path)
    layout = _layout(path) if suffix in TEXT_SUFFIXES else None
    return layout is not None and layout.names[-1] == SEGMENT_DIMENSION


def _has_sign(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(_LAS_POINTS_AT)
        points_at = int.from_bytes(file.read(4), "little")
        file.seek(0)
        return LAS_SIGN in file.read(min(points_at, _MOST_HEADER))


def _is_our_text(path: Path, inputs: Sequence[Path]) -> bool:
    layout = _layout(path)
    if layout is not None and layout.names[-1] == SEGMENT_DIMENSION:
        return True
    words, columns = _first_point(path), _COLUMNS_OF_COORDINATES
    if inputs and inputs[0].suffix.lower() in TEXT_SUFFIXES:
        columns = len(_first_point(inputs[0]))
    return len(words) == columns + 1 and re.fullmatch(r"-1|\d+", words[-1].strip()) is not None


def _first_point(path: Path) -> list[str]:
    """Split the first line of points; nothing if there is none."""
    source = _source(path)
    if source is None:
        return []
    try:
        (line,), _ = next(source.lines(1), ([""], None))
    except (StreamsegError, OSError):
        return []
    return line.split(source.layout.delimiter)


def _layout(path: Path) -> TextLayout | None:
    source = _source(path)
    return None if source is None else source.layout


def _source(path: Path) -> TextSource | None:
    try:
        return TextSource(path) if path.is_file() else None
    except (StreamsegError, OSError):
        return None
