"""Which columns are x, y and z, by their names."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

# What x and y are called, whatever their case: the first pair that is there. The last ones are degrees.
_IN_DEGREES = (("lon", "lat"), ("longitude", "latitude"), ("long", "lat"), ("lng", "lat"))
_PAIRS = (("x", "y"), ("easting", "northing"), ("east", "north"), ("e", "n"), *_IN_DEGREES)
_HEIGHTS = ("z", "height", "elevation", "altitude", "h")

_MOST_SHOWN = 20
_LONGEST_SHOWN = 20

ALLOWED = "x, y and z (or easting, northing and height)"


class Axes(NamedTuple):
    """What the names of columns say.

    places : indices of x, y and z; None where no name, or more than one, says it
    missing : those of "x", "y" and "z" that no name says
    twins : names that say the same in different spelling, where none of them is the right one for sure
    in_degrees : whether x and y are longitude and latitude
    """

    places: tuple[int, int, int] | None
    missing: tuple[str, ...] = ()
    twins: tuple[str, ...] = ()
    in_degrees: bool = False

    def problem(self) -> str:
        """Say why it is not clear where x, y and z are; empty if it is."""
        if self.twins:
            return f"which of {listed(self.twins)} is meant is not clear"
        return f"which of them is {' and '.join(self.missing)} is not clear" if self.missing else ""


def axes_of(names: Sequence[str]) -> Axes:
    """Find x, y and z.

    Where names differ in case only, those count that are spelled alike: ``x`` of x, X, y, z; but x, y, z, X, Y, Z are
    not clear.
    """
    lower = [name.lower() for name in names]
    pair = next((pair for pair in _PAIRS if set(pair) <= set(lower)), None)
    height = next((name for name in _HEIGHTS if name in lower), None)
    if pair is None or height is None:
        return Axes(None, missing=_missing(lower, pair, height))
    in_degrees = pair in _IN_DEGREES
    wanted = (*pair, height)
    places = [[place for place, name in enumerate(lower) if name == one] for one in wanted]
    if any(len(each) > 1 for each in places):
        places = _spelled_alike(names, wanted)
    if not places:
        twins = [name for name, low in zip(names, lower, strict=True) if low in wanted and lower.count(low) > 1]
        return Axes(None, twins=tuple(twins))
    (x,), (y,), (z,) = places
    return Axes((x, y, z), in_degrees=in_degrees)


def listed(names: Sequence[str]) -> str:
    """List names for people: not all of many, and not all of long ones."""
    shown = [name if len(name) <= _LONGEST_SHOWN else f"{name[:_LONGEST_SHOWN]}…" for name in names[:_MOST_SHOWN]]
    return ", ".join([*shown, "…"] if len(names) > _MOST_SHOWN else shown)


def _spelled_alike(names: Sequence[str], wanted: tuple[str, ...]) -> list[list[int]]:
    spellings = {tuple(map(style, wanted)) for style in (str.lower, str.upper, str.capitalize)}
    whole = [spelling for spelling in spellings if all(names.count(name) == 1 for name in spelling)]
    return [[names.index(name)] for name in whole[0]] if len(whole) == 1 else []


def _missing(lower: Sequence[str], pair: tuple[str, str] | None, height: str | None) -> tuple[str, ...]:
    missing = [] if height else ["z"]
    if pair is None:
        said = [any(names[axis] in lower for names in _PAIRS) for axis in range(2)]
        # x of one kind and y of another are no pair.
        missing = [name for name, is_said in zip("xy", said, strict=True) if not is_said or all(said)] + missing
    return tuple(missing)
