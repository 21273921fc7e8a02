"""GeoTIFF keys of coordinate systems, as older LAS files hold them."""

from __future__ import annotations

import struct
from typing import NamedTuple

from .units import angular_unit_of_code, linear_unit, linear_unit_of_code
from .wkt import StatedSystem

_MODEL_TYPE, _CITATION = 1024, 1026
_GEOGRAPHIC_TYPE, _GEOGRAPHIC_CITATION, _ANGULAR_UNIT = 2048, 2049, 2054
_PROJECTED_TYPE, _PROJECTED_CITATION, _LINEAR_UNIT, _LINEAR_UNIT_SIZE = 3072, 3073, 3076, 3077
_VERTICAL_TYPE, _VERTICAL_UNIT = 4096, 4099
_PROJECTED, _GEOGRAPHIC, _GEOCENTRIC = 1, 2, 3
_DOUBLES, _TEXTS = 34736, 34737
_HEAD, _ENTRY = 8, 8
_USER_DEFINED = 32767

# Projected systems of these hundreds of EPSG numbers are in meters, those of UTM; heights of these numbers too, or not.
_METRIC_HUNDREDS = {258, 269, 326, 327}
_VERTICAL_CODES = {5703: "m", 6360: "US survey ft", 8228: "ft"}


class GeoKeys(NamedTuple):
    """The keys of a file.

    numbers : those that are whole numbers
    texts, doubles : the others
    """

    numbers: dict[int, int]
    texts: dict[int, str]
    doubles: dict[int, float]

    def said(self) -> StatedSystem | None:
        """Tell what the keys say of the coordinates; None if nothing."""
        numbers = self.numbers
        model = numbers.get(_MODEL_TYPE) or (_PROJECTED if _PROJECTED_TYPE in numbers else None)
        if model is None and _GEOGRAPHIC_TYPE in numbers:
            model = _GEOGRAPHIC
        if model is None:
            return None
        vertical = linear_unit_of_code(numbers.get(_VERTICAL_UNIT, 0))
        vertical = vertical or _VERTICAL_CODES.get(numbers.get(_VERTICAL_TYPE, 0))
        if model == _GEOGRAPHIC:
            name = self._name(_GEOGRAPHIC_TYPE, _GEOGRAPHIC_CITATION)
            return StatedSystem(name, angular_unit_of_code(numbers.get(_ANGULAR_UNIT, 0)), True, vertical)
        if model == _GEOCENTRIC:
            return StatedSystem(
                f"{self._name(_GEOGRAPHIC_TYPE, _GEOGRAPHIC_CITATION)}, geocentric", None, False, vertical
            )
        return StatedSystem(self._name(_PROJECTED_TYPE, _PROJECTED_CITATION), self._linear_unit(), False, vertical)

    def _linear_unit(self) -> str | None:
        code = self.numbers.get(_LINEAR_UNIT, 0)
        if code == _USER_DEFINED and _LINEAR_UNIT_SIZE in self.doubles:
            return linear_unit("", self.doubles[_LINEAR_UNIT_SIZE])
        is_metric = self.numbers.get(_PROJECTED_TYPE, 0) // 100 in _METRIC_HUNDREDS
        return linear_unit_of_code(code) or ("m" if is_metric and code == 0 else None)

    def _name(self, code_key: int, citation_key: int) -> str:
        """Name the system: as a citation does, else by its number."""
        for key in (citation_key, _CITATION):
            # Some writers give a list such as "PCS Name = NAD83 / UTM zone 15N|Datum = …".
            first = self.texts.get(key, "").split("|")[0].split(" = ")[-1].strip()
            if first:
                return first
        code = self.numbers.get(code_key, _USER_DEFINED)
        return "a system of its own" if code == _USER_DEFINED else f"EPSG:{code}"


def read_keys(directory: bytes, doubles: bytes, texts: bytes) -> GeoKeys:
    """Read the three records that hold the keys; what points outside of them is left out."""
    keys = GeoKeys({}, {}, {})
    for at in range(_HEAD, len(directory) - _ENTRY + 1, _ENTRY):
        key, place, count, value = struct.unpack_from("<4H", directory, at)
        if place == 0:
            keys.numbers.setdefault(key, value)
        elif place == _TEXTS:
            keys.texts.setdefault(key, texts[value : value + count].split(b"\0")[0].decode("utf-8", "replace"))
        elif place == _DOUBLES and len(doubles) >= 8 * (value + 1):
            keys.doubles.setdefault(key, struct.unpack_from("<d", doubles, 8 * value)[0])
    return keys
