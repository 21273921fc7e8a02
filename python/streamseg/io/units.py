"""Units of coordinates, by the names, factors and codes that files have for them."""

from __future__ import annotations

from math import isclose

METERS, FEET, SURVEY_FEET, DEGREES = "m", "ft", "US survey ft", "degrees"

# How units are shown beside a number.
ABBREVIATIONS = {METERS: "m", FEET: "ft", SURVEY_FEET: "ft", DEGREES: "°"}

_METERS_PER = {METERS: 1.0, FEET: 0.3048, SURVEY_FEET: 1200 / 3937, "km": 1000.0, "cm": 0.01, "mm": 0.001}
_LINEAR_NAMES = {
    "metre": METERS,
    "meter": METERS,
    "m": METERS,
    "foot": FEET,
    "ft": FEET,
    "international foot": FEET,
    "us survey foot": SURVEY_FEET,
    "foot_us": SURVEY_FEET,
    "ftus": SURVEY_FEET,
    "us_survey_foot": SURVEY_FEET,
}
_RADIANS_PER = {DEGREES: 0.017453292519943295, "radians": 1.0, "grads": 0.015707963267948967}

_LINEAR_CODES = {9001: METERS, 9002: FEET, 9003: SURVEY_FEET, 9036: "km"}
_ANGULAR_CODES = {9101: "radians", 9105: "grads", 9106: "grads"}


def linear_unit(name: str, meters: float | None = None) -> str | None:
    """Name a unit of length, by its size if that is known; the name of one that is not in the table stays."""
    if meters is not None:
        # 0.3048 and 0.3048006 differ in the sixth digit.
        return next((unit for unit, size in _METERS_PER.items() if isclose(size, meters, rel_tol=5e-7)), name or None)
    return _LINEAR_NAMES.get(name.lower(), name or None)


def angular_unit(name: str, radians: float | None = None) -> str:
    """Name a unit of angles: degrees where nothing else is said."""
    if radians is None:
        return name if name and not name.lower().startswith("deg") else DEGREES
    return next((unit for unit, size in _RADIANS_PER.items() if isclose(size, radians, rel_tol=1e-6)), name or DEGREES)


def linear_unit_of_code(code: int) -> str | None:
    """Name the unit of length that EPSG has under a number."""
    return _LINEAR_CODES.get(code)


def angular_unit_of_code(code: int) -> str:
    """Name the unit of angles that EPSG has under a number."""
    return _ANGULAR_CODES.get(code, DEGREES)
