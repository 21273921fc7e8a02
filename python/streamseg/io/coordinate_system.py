"""What a cloud says of its coordinates: the name of their system, their units, and whether they are angles."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple

from .geokeys import read_keys
from .units import DEGREES
from .wkt import StatedSystem, said_by

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .las_records import Record

PROJECTION_USER = "LASF_Projection"
_GEOKEYS, _DOUBLES, _TEXTS, _WKT = 34735, 34736, 34737, 2112
_LONGEST = 1 << 20  # bytes of a record; what is longer is no description
_USERS_OF_WKT = (PROJECTION_USER, "liblas")

# Longitudes and latitudes; some writers count longitudes to 360.
_MOST_LONGITUDE, _MOST_LATITUDE = 360.0, 90.0

# A step of a ten-millionth of a degree is a centimeter on the ground, which is what heights have steps of.
_LARGEST_STEP_OF_DEGREES = 1e-6
_STEPS_OF_HEIGHT = 1000.0


class CoordinateSystem(NamedTuple):
    """The coordinate system of a cloud.

    name : such as "NAD83 / UTM zone 15N" or "EPSG:26915"
    unit : of x and y: "m", "ft", "US survey ft", "degrees", or as the file calls it; None where it does not say
    is_geographic : whether x and y are longitude and latitude
    vertical_unit : of z; None where nothing is said
    """

    name: str
    unit: str | None
    is_geographic: bool
    vertical_unit: str | None


# For clouds whose columns are called so.
LONGITUDE_LATITUDE = CoordinateSystem("longitude and latitude", DEGREES, True, None)


class Stated(NamedTuple):
    """What the records of a file say, by the kind of record; for comparison with other files."""

    keys: dict[int, int]
    wkt: str

    def contradicts(self, other: Stated) -> bool:
        """Whether a kind of record that both have says something else."""
        pairs = ((self.keys, other.keys), (self.wkt, other.wkt))
        return any(mine and theirs and mine != theirs for mine, theirs in pairs)

    def __bool__(self) -> bool:
        return bool(self.keys or self.wkt)


def read_system(records: Sequence[Record], prefers_wkt: bool) -> tuple[CoordinateSystem | None, Stated]:
    """Read what the records of a file say of its coordinate system."""
    by_id: dict[int, bytes] = {}
    for record in records:
        user, number = record.key
        is_known = user == PROJECTION_USER or (number == _WKT and user in _USERS_OF_WKT)
        if is_known and len(record.data) <= _LONGEST:
            by_id.setdefault(number, bytes(record.data))
    directory = by_id.get(_GEOKEYS, b"")
    keys = read_keys(directory, by_id.get(_DOUBLES, b""), by_id.get(_TEXTS, b""))
    text = by_id.get(_WKT, b"").decode("utf-8", "replace").strip("\0 \r\n\t")
    answers: list[StatedSystem | None] = [keys.said(), said_by(text)]
    if prefers_wkt:
        answers.reverse()
    said = next((answer for answer in answers if answer is not None), None)
    # Blanks say nothing.
    return said and CoordinateSystem(*said), Stated(keys.numbers, "".join(text.split()))


def looks_like_degrees(box: Sequence[tuple[float, float]], scale: Sequence[float]) -> bool:
    """Whether a cloud that says nothing of its system is in degrees for almost sure, by bounding box and scale.

    Of clouds in meters all axes have about the same steps. Only degrees need steps along x and y that are a thousand
    times finer than those of the heights.
    """
    finest = max(scale[:2])
    return _is_on_earth(box) and finest <= _LARGEST_STEP_OF_DEGREES and scale[2] >= _STEPS_OF_HEIGHT * finest


class Judgement(NamedTuple):
    """What distances between the points of a cloud are.

    in_degrees : whether x and y are angles, so that there are no lengths to measure with
    caution : one sentence, if distances are not what they seem
    is_contradicted : whether the coordinates cannot be of the system that the cloud names
    """

    in_degrees: bool = False
    caution: str | None = None
    is_contradicted: bool = False


def judged(
    system: CoordinateSystem | None, box: Sequence[tuple[float, float]] | None, looks_so: bool = False
) -> Judgement:
    """Judge by the system that a cloud names, and by what else is known of it.

    `box` is the bounding box in x and y, if it is known; `looks_so` whether the cloud looks like degrees.
    """
    if system is not None and system.is_geographic:
        if box is not None and _is_beyond_earth(box):
            return Judgement(False, _contradiction(system), True)
        return Judgement(
            True,
            f"the coordinates are longitude and latitude in {system.unit or DEGREES} ({system.name}), and "
            "distances are taken in that unit; reproject the cloud to a projected system first",
        )
    if system is None and looks_so:
        return Judgement(
            True,
            "the coordinates look like longitude and latitude in degrees, though the cloud names no coordinate system, "
            "and distances are taken in that unit; reproject it to a projected system first",
        )
    return Judgement(False, _mixture(system))


def _contradiction(system: CoordinateSystem) -> str:
    return (
        f"the coordinate system of the cloud ({system.name}) says that x and y are longitude and latitude, but they "
        f"are beyond ±{_MOST_LONGITUDE:g} and ±{_MOST_LATITUDE:g}; distances are taken in their unit, whatever it is"
    )


def _mixture(system: CoordinateSystem | None) -> str | None:
    vertical = system.vertical_unit if system is not None else None
    if system is not None and vertical is not None and system.unit is not None and vertical != system.unit:
        return (
            f"x and y are in {system.unit}, z is in {vertical} ({system.name}): distances in space mix the two; bring "
            "the cloud to one unit first"
        )
    return None


def _is_on_earth(box: Sequence[tuple[float, float]]) -> bool:
    limits = (_MOST_LONGITUDE, _MOST_LATITUDE)
    return all(-limit <= low <= high <= limit for (low, high), limit in zip(box, limits, strict=False))


def _is_beyond_earth(box: Sequence[tuple[float, float]]) -> bool:
    """Whether a box that is one is not on earth, not even if x is the latitude."""
    is_box = all(-inf < low <= high < inf for low, high in box)
    return is_box and not _is_on_earth(box) and not _is_on_earth(box[::-1])
