"""The column of segment ids in an output: its name and its type."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidParameter
from .labels import SEGMENT_DIMENSION
from .spelling import letters_of
from .text import SUFFIXES as TEXT_SUFFIXES

if TYPE_CHECKING:
    from pathlib import Path

# LAS has room for 32 bytes; many readers expect the last of them to be 0.
_LONGEST_NAME = 31
_IN_NO_TEXT = " ,;\"'#"
# Much longer lines are not taken for names when they are read again.
_LONGEST_WORD = 100
_LONGEST_SHOWN = 120

# Names that dimensions of some point format have, without what does not matter in them.
STANDARD_NAMES = frozenset(
    {
        "bitfields", "blue", "classification", "classificationflags", "edgeofflightline",
        "gpstime", "green", "intensity", "keypoint", "nir", "numberofreturns", "overlap",
        "pointsourceid", "rawclassification", "red", "returnnumber", "returnpointwavelocation",
        "scanangle", "scananglerank", "scandirectionflag", "scannerchannel", "synthetic",
        "userdata", "wavepacketindex", "wavepacketoffset", "wavepacketsize", "withheld", "x",
        "xt", "y", "yt", "z", "zt",
    }
)  # fmt: skip

_MOST_SMALL_IDS = 2**31


def checked_id_name(name: str | None, out: Path) -> str:
    """Return the name that the ids have in `out`.

    Raises
    ------
    InvalidParameter
        The name cannot be written, or means something else there.
    """
    if name is None:
        return SEGMENT_DIMENSION
    suffix = out.suffix.lower()
    if suffix in TEXT_SUFFIXES:
        if not _is_word(name):
            raise InvalidParameter(
                f"id_name is {_shown(name)}, allowed for text: a word of at most {_LONGEST_WORD} bytes "
                "without blanks, commas or quotes"
            )
    elif suffix == ".npy":
        raise InvalidParameter(f"id_name is {name!r}, allowed: for LAS, LAZ and text; {out.name} holds the ids alone")
    elif not _is_short_and_plain(name):
        raise InvalidParameter(
            f"id_name is {_shown(name)}, allowed for LAS: 1 to {_LONGEST_NAME} ASCII letters, digits, marks"
        )
    if letters_of(name) in STANDARD_NAMES:
        raise InvalidParameter(f"id_name is {name!r}, allowed: a name that no dimension of LAS points has")
    return name


def id_type(points: int | None, largest_id: int) -> np.dtype[Any]:
    """Choose the type of the ids of a run of so many points: 32 bits where they fit, which every viewer can show."""
    fits = points is not None and max(points, largest_id) < _MOST_SMALL_IDS
    return np.dtype(np.int32 if fits else np.int64)


def _is_word(name: Any) -> bool:
    """Whether it can stand in a line of names; what UTF-8 cannot write is not printable."""
    if not isinstance(name, str) or not name.isprintable() or any(mark in name for mark in _IN_NO_TEXT):
        return False
    return 0 < len(name.encode()) <= _LONGEST_WORD


def _shown(name: Any) -> str:
    text = repr(name)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"


def _is_short_and_plain(name: Any) -> bool:
    is_text = isinstance(name, str) and name.isascii() and name.isprintable()
    return is_text and 0 < len(name.strip()) == len(name) <= _LONGEST_NAME
