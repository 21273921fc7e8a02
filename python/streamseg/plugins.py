"""Segmentors of other packages, found by the entry points that they announce."""

from __future__ import annotations

import functools
import inspect
from importlib.metadata import entry_points
from typing import Any

from .errors import InvalidParameter

GROUP = "streamseg.segmentors"


def plugin_names() -> list[str]:
    """Name the segmentors that installed packages announce under the entry points ``streamseg.segmentors``.

    Returns
    -------
    list of str
        Names for `plugin` and for ``--method``, in alphabetical order.

    Examples
    --------
    >>> import streamseg as ss
    >>> "no such name" in ss.plugin_names()
    False
    """
    return sorted(entry_points(group=GROUP).names)


def plugin(name: str, **parameters: Any) -> Any:
    """Make a segmentor that an installed package announces.

    What the package announces is a class, or a function that returns a segmentor; or, if its first parameter is called
    ``window``, a function that is a segmentor itself.

    Parameters
    ----------
    name : str
        One of `plugin_names`.
    **parameters
        Handed to the class or function; a function of the window gets them with each window.

    Returns
    -------
    segmentor
        Anything that `stream` takes.

    Raises
    ------
    InvalidParameter
        If no package announces that name, or several do; if it cannot be loaded, or does not take the parameters.

    Examples
    --------
    >>> import streamseg as ss
    >>> names = ss.plugin_names()  # then, with one of them: segmentor = ss.plugin(name)
    """
    announced = _load(name)
    try:
        if _is_of_window(announced):
            return _with_parameters(announced, parameters)
        return announced(**parameters)
    except TypeError as error:
        raise InvalidParameter(f"segmentor '{name}' does not take these parameters: {error}") from error


def _load(name: str) -> Any:
    entries = tuple(entry_points(group=GROUP, name=name))
    if not entries:
        there = ", ".join(plugin_names()) or "none"
        raise InvalidParameter(f"segmentor '{name}' is announced by no installed package; there are: {there}")
    if len(entries) > 1:
        packages = " and ".join(sorted(entry.dist.name if entry.dist else entry.value for entry in entries))
        raise InvalidParameter(f"segmentor '{name}' is announced by {packages}; uninstall all but one of them")
    try:
        return entries[0].load()
    except (ImportError, AttributeError) as error:
        raise InvalidParameter(f"segmentor '{name}' cannot be loaded from {entries[0].value}: {error}") from error


def _is_of_window(announced: Any) -> bool:
    """Whether it is a function of the window, not something that makes a segmentor."""
    if inspect.isclass(announced):
        return False
    try:
        return next(iter(inspect.signature(announced).parameters), None) == "window"
    except (TypeError, ValueError):  # not callable, or compiled without a signature
        return False


def _with_parameters(segmentor: Any, parameters: dict[str, Any]) -> Any:
    """Bind the parameters; its name and what else the function has, such as `attributes`, stay."""
    inspect.signature(segmentor).bind("window", **parameters)
    return functools.update_wrapper(functools.partial(segmentor, **parameters), segmentor)
