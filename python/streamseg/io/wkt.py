"""Well-known text of coordinate systems, as LAS files hold it (WKT 1 and 2), and what it says of units."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from .units import DEGREES, angular_unit, linear_unit

if TYPE_CHECKING:
    from collections.abc import Iterator

_TOKENS = re.compile(r'"((?:[^"]|"")*)"|([A-Za-z_][A-Za-z0-9_]*)|([-+0-9.][-+0-9.eE]*)|([\[\](),])|\s+|(.)', re.S)
# Whoever nests deeper does not describe a coordinate system.
_DEEPEST = 64

_GEOGRAPHIC = {"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS"}
_PROJECTED = {"PROJCS", "PROJCRS", "PROJECTEDCRS"}
_VERTICAL = {"VERT_CS", "VERTCRS", "VERTICALCRS"}
_OTHER_HORIZONTAL = {"LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS", "DERIVEDPROJCRS", "FITTED_CS"}
_COMPOUND = {"COMPD_CS", "COMPOUNDCRS"}
_UNITS = {"UNIT", "LENGTHUNIT", "ANGLEUNIT"}


class Node(NamedTuple):
    """A keyword with all that stands in its brackets."""

    keyword: str
    parts: list[Node | str]

    @property
    def name(self) -> str:
        """The text that comes first."""
        return next((part for part in self.parts if isinstance(part, str)), "")

    def children(self, keywords: set[str]) -> Iterator[Node]:
        """Yield the parts that are one of these keywords."""
        return (part for part in self.parts if isinstance(part, Node) and part.keyword in keywords)


class StatedSystem(NamedTuple):
    """What a text says; see `CoordinateSystem`."""

    name: str
    unit: str | None
    is_geographic: bool
    vertical_unit: str | None


def said_by(text: str) -> StatedSystem | None:
    """Tell what a text says of the coordinates; None if it is no coordinate system."""
    root = parsed(text)
    if root is None:
        return None
    systems = list(_systems(root))
    horizontal = next((one for one in systems if one.keyword not in _VERTICAL), None)
    if horizontal is None:
        return None
    is_geographic = horizontal.keyword in _GEOGRAPHIC and not _is_cartesian(horizontal)
    units = _axis_units(horizontal, is_geographic)
    vertical = next((_axis_units(one, False)[0] for one in systems if one.keyword in _VERTICAL), units[-1])
    name = root.name or horizontal.name
    return StatedSystem(name, units[0] or (DEGREES if is_geographic else None), is_geographic, vertical)


def parsed(text: str) -> Node | None:
    """Parse a text; None if it is none of this kind."""
    top = Node("", [])
    stack, keyword = [top], ""
    for found in _TOKENS.finditer(text.strip("\0 \t\r\n")):
        quoted, word, number, mark, odd = found.groups()
        if odd is not None:
            return None
        if mark in ("[", "("):
            if not keyword or len(stack) > _DEEPEST:
                return None
            node = Node(keyword.upper(), [])
            stack[-1].parts.append(node)
            stack.append(node)
        elif mark is not None and keyword:  # a word alone
            stack[-1].parts.append(keyword)
        if mark in ("]", ")"):
            if len(stack) == 1:
                return None
            stack.pop()
        if quoted is not None or number is not None:
            stack[-1].parts.append(quoted.replace('""', '"') if quoted is not None else number)
        keyword = word if word is not None else "" if mark is not None else keyword
    root = top.parts[0] if len(stack) == 1 and len(top.parts) == 1 else None
    return root if isinstance(root, Node) else None


def _systems(node: Node) -> Iterator[Node]:
    """Yield the systems that a compound one has, or the one that there is."""
    if node.keyword in _GEOGRAPHIC | _PROJECTED | _VERTICAL | _OTHER_HORIZONTAL:
        yield node
    elif node.keyword == "BOUNDCRS":
        for source in node.children({"SOURCECRS"}):
            for part in source.parts:
                if isinstance(part, Node):
                    yield from _systems(part)
    elif node.keyword in _COMPOUND:
        for part in node.parts:
            if isinstance(part, Node):
                yield from _systems(part)


def _is_cartesian(system: Node) -> bool:
    """Whether a geodetic system has its origin in the center of the earth."""
    return any(part.name.lower() == "cartesian" for part in system.children({"CS"}))


def _axis_units(system: Node, is_geographic: bool) -> tuple[str | None, str | None]:
    """Find the unit of the first axis, and that of the third if there is one."""
    own = [_unit(node, is_geographic) for node in system.children(_UNITS)]
    axes = list(system.children({"AXIS"}))
    of_axes = [next((_unit(node, is_geographic) for node in axis.children(_UNITS)), None) for axis in axes]
    first = (of_axes[0] if of_axes else None) or (own[-1] if own else None)
    third = None
    if len(axes) == 3:
        third = of_axes[2] or (None if is_geographic else first)
    return first, third


def _unit(node: Node, is_geographic: bool) -> str | None:
    texts = [part for part in node.parts if isinstance(part, str)]
    factor = float(texts[1]) if len(texts) > 1 and _is_number(texts[1]) else None
    is_angle = node.keyword == "ANGLEUNIT" or (node.keyword == "UNIT" and is_geographic)
    return (angular_unit if is_angle else linear_unit)(node.name, factor)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
