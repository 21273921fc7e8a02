"""Segmentors of other packages, found by the entry points that they announce."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from .errors import InvalidParameter

GROUP = "streamseg.segmentors"


def plugin_names() -> list[str]:
    """Name the segmentors that installed packages announce under the entry points ``streamseg.segmentors``."""
    return sorted(_entries())


def plugin(name: str, **parameters: Any) -> Any:
    """Make a segmentor that an installed package announces.

    Parameters
    ----------
    name : str
        One of `plugin_names`.
    **parameters
        Handed to what the entry point names: a class, or a function that returns a segmentor. If there are none and it
        is a function of the window (it has an attribute ``is_segmentor``), it is the segmentor itself.

    Returns
    -------
    segmentor
        Anything that `stream` takes.

    Raises
    ------
    InvalidParameter
        If no package announces that name, or it does not take the parameters.

    Examples
    --------
    >>> import streamseg as ss
    >>> isinstance(ss.plugin_names(), list)
    True
    """
    entries = _entries()
    if name not in entries:
        there = ", ".join(sorted(entries)) or "none"
        raise InvalidParameter(f"segmentor '{name}' is announced by no installed package; there are: {there}")
    made = entries[name].load()
    if getattr(made, "is_segmentor", False):
        return made
    try:
        return made(**parameters)
    except TypeError as error:
        raise InvalidParameter(f"segmentor '{name}' does not take these parameters: {error}") from error


def _entries() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}
