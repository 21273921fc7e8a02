"""What people are told: by the names that they typed, and of a plug-in's failure only what is the plug-in's."""

from __future__ import annotations

import contextlib
import re
import traceback
from collections.abc import Iterator, Mapping

from ..errors import InvalidParameter
from ..stream import Stream

# Parameters of runs that are refused only when something runs, and the voxels that are too small for a cloud.
_OF_RUNS = ("spans", "overlap", "direction", "max_memory", "threads", "history")
_BY_HAND = {**{name: f"--{name.replace('_', '-')}" for name in _OF_RUNS}, "size": "--voxel"}

# As much of a number as the core shows.
_LONGEST_NUMBER = 40


@contextlib.contextmanager
def called(**options: str) -> Iterator[None]:
    """Name the options for the parameters, where what is done within refuses one: ``called(width="--span-width")``."""
    try:
        yield
    except InvalidParameter as error:
        raise type(error)(_renamed(str(error), options)) from None


def as_typed(message: str, options: Mapping[str, str]) -> str:
    """Name the options that are typed, which are given by their parameters, and those of runs."""
    options = {**_BY_HAND, **options}
    message = _renamed(message, options)
    message = re.sub(
        r"(?<![^\s(])[a-z]+(?:_[a-z]+)+(?=[\s,;)]|$)", lambda found: options.get(found[0], found[0]), message
    )
    message = re.sub(r"\b(overwrite|result|revisit)=(?:True|'(\w+)')(?: \(--\w+\))?", _assigned, message)
    return re.sub(rf"(\d{{{_LONGEST_NUMBER}}})\d+", r"\1…", message)


def _renamed(message: str, options: Mapping[str, str]) -> str:
    return re.sub(r"^\w+(?= (?:is|and) )", lambda found: options.get(found[0], found[0]), message)


def _assigned(found: re.Match[str]) -> str:
    name, value = found.groups()
    return f"--{name} {value}" if value else f"--{name}"


def of_plugin(error: BaseException) -> str | None:
    """Tell what a segmentor in Python raised, in which window and where in its own code; None if it was not that."""
    raised_in = getattr(error, "_streamseg_raised_in", None)
    if raised_in is None:
        return None
    frames = traceback.extract_tb(error.__traceback__)
    starts = [place for place, frame in enumerate(frames) if frame.name == Stream._next_woven.__name__]
    own = traceback.format_list(frames[starts[0] + 1 :] if starts else frames)
    name, window = raised_in
    what = "".join(traceback.format_exception_only(type(error), error)).strip()
    return f"segmentor '{name}' raised in window {window}: {what}\n{''.join(own)}".rstrip()
