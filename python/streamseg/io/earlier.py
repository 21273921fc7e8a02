"""Whether a file is an earlier output of streamseg, which may be replaced, or somebody's work, which may not.

LAS and LAZ bear a sign: the description of the dimension that holds the ids. An ``.npy`` of ids is one row of 64-bit
whole numbers from −1 on. Text bears a sign only where it has a line of names that ends in ``SegmentID``; other text
has to begin with the first point of the input and a whole number.
"""

from __future__ import annotations

import re
import warnings
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np

from ..errors import StreamsegError
from .labels import LAS_SIGN, NO_SEGMENT, SEGMENT_DIMENSION
from .opening import real
from .text import SUFFIXES as TEXT_SUFFIXES
from .text import TextSource
from .text_numbers import split

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

_LAS_SUFFIXES = (".las", ".laz")
_LAS_MAGIC, _NPY_MAGIC, _PNG_MAGIC = b"LASF", b"\x93NUMPY", b"\x89PNG\r\n\x1a\n"
_LAS_POINTS_AT = 96
# A text in the file, which stands before the pixels.
PICTURE_SIGN = ("Software", "streamseg")
_MOST_PICTURE_HEAD = 1 << 10
_MOST_HEADER = 1 << 24
_NPY_OF_IDS = re.compile(rb"{'descr': '<i8', 'fortran_order': False, 'shape': \(\d+,\), } *\n")
_NPY_HEADER_AT, _NPY_IDS_AT, _SNIFFED_BYTES = 10, 128, 1 << 14
# Digits that single precision is written with.
_ROUNDING = 1e-8


def foreign(out: Path, inputs: Sequence[Path], id_name: str = SEGMENT_DIMENSION) -> str | None:
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
        return _foreign_text(out, inputs, id_name)
    with open(out, "rb") as file:
        head = file.read(_SNIFFED_BYTES)
    if suffix == ".npy":
        is_ours = not head.startswith(_NPY_MAGIC) or _are_ids(head)
        return None if is_ours else "an array that streamseg has not written"
    is_ours = not head.startswith(_LAS_MAGIC) or _has_sign(out)
    return None if is_ours else "a cloud that streamseg has not written"


def foreign_picture(out: Path) -> str | None:
    """Say what a file is that is no picture of streamseg; None if it is one, or has no content."""
    with open(out, "rb") as file:
        head = file.read(_MOST_PICTURE_HEAD)
    if not head or b"\0".join(word.encode() for word in PICTURE_SIGN) in head:
        return None
    return "a picture that streamseg has not drawn" if head.startswith(_PNG_MAGIC) else "no picture"


def is_like_inputs(out: Path, inputs: Sequence[Path], id_name: str = SEGMENT_DIMENSION) -> bool:
    """Whether a labelled cloud looks like one more of the inputs: several labelled ones beside it."""
    return len(inputs) > 1 and all(
        path.suffix.lower() == out.suffix.lower()
        and real(path).parent == real(out).parent
        and _is_labelled(path, id_name)
        for path in inputs
    )


def _is_labelled(path: Path, id_name: str) -> bool:
    suffix = path.suffix.lower()
    if suffix in _LAS_SUFFIXES:
        return path.is_file() and _has_sign(path)
    source = _source(path) if suffix in TEXT_SUFFIXES else None
    return source is not None and source.layout.names[-1] in (SEGMENT_DIMENSION, id_name)


def _has_sign(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(_LAS_POINTS_AT)
        points_at = int.from_bytes(file.read(4), "little")
        file.seek(0)
        return LAS_SIGN in file.read(min(points_at, _MOST_HEADER))


def _are_ids(head: bytes) -> bool:
    """Whether an array begins as one of ids does."""
    if not _NPY_OF_IDS.fullmatch(head[_NPY_HEADER_AT:_NPY_IDS_AT]):
        return False
    whole = (len(head) - _NPY_IDS_AT) // 8
    return bool((np.frombuffer(head, "<i8", whole, _NPY_IDS_AT) >= NO_SEGMENT).all())


def _foreign_text(out: Path, inputs: Sequence[Path], id_name: str) -> str | None:
    source = _source(out)
    name = source.layout.names[-1] if source is not None and source.layout.header is not None else None
    if name == SEGMENT_DIMENSION:
        return None
    if source is None or (name is not None and name != id_name):
        return "a text that streamseg has not written"
    if inputs and _begins_like(source, inputs[0]):
        return None
    return "a text that, by its first line, streamseg has not written"


def _begins_like(labelled: TextSource, path: Path) -> bool:
    """Whether a text begins with the first point of a file and an id."""
    words = _first_words(labelled)
    if not words or not re.fullmatch(r"-1|\d+", words[-1].strip()):
        return False
    if path.suffix.lower() in TEXT_SUFFIXES:
        source = _source(path)
        return source is not None and _first_words(source) == words[:-1]
    try:
        return bool(np.allclose([float(word) for word in words[:-1]], _first_point(path), _ROUNDING, 0, True))
    except (ValueError, StreamsegError, OSError):
        return False


def _first_words(source: TextSource) -> list[str]:
    """Split the first line of points; nothing if there is none."""
    try:
        with closing(source.lines(1)) as lines:
            (line,), _ = next(lines, ([""], None))
    except (StreamsegError, OSError):
        return []
    return split(line, source.layout.delimiter)


def _first_point(path: Path) -> NDArray[np.float64]:
    """Read the coordinates of the first point of a file of any kind."""
    from . import open_cloud

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the run has the same to say
        cloud = open_cloud(path)
        with closing(cloud.chunks(1)) as chunks:
            first: NDArray[np.float64] = cloud.lattice.to_coordinates(next(chunks).points)[0]
    return first


def _source(path: Path) -> TextSource | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it is not read for its points
            return TextSource(path) if path.is_file() else None
    except (StreamsegError, OSError):
        return None
