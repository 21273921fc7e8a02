"""What one reading of a cloud tells: how many points, how far they reach, in which order, of which classes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .sample import Sampler, finite

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..io import Cloud

# An attribute with more different values than this, or with broken ones, holds no classes.
_MOST_CLASSES = 256

_READ = ("classification", "number_of_returns", "gps_time")


@dataclass
class Survey:
    """The facts of a cloud, complete once all chunks have been seen."""

    points: int = 0
    invalid: int = 0
    low: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    high: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    classes: dict[int, int] | None = None
    """Points of each class; None if the cloud has no classes."""
    has_classes: bool = True
    """False once values turned up that are no classes."""
    of_many_returns: int | None = None
    """Points of pulses with more than one return; None if the cloud does not say."""
    steps_back: dict[str, int] = field(default_factory=dict)
    """How often x, y and the time become less from point to point."""
    name: str | None = None
    unit: str | None = None
    vertical_unit: str | None = None
    in_degrees: bool = False
    """Whether x and y are angles, by all that is known."""
    has_lengths_of_unit: bool = True
    """False if the coordinates cannot be in the unit that is named."""
    caution: str | None = None
    """Why distances are not what they seem."""

    @property
    def has_extent(self) -> bool:
        """Whether there is any point with finite coordinates."""
        return self.points > self.invalid

    @property
    def extent(self) -> NDArray[np.float64]:
        """How far the points reach along x, y and z; with numbers near the end of their range it can be infinite."""
        with np.errstate(over="ignore"):
            return self.high - self.low


def surveyed(cloud: Cloud, sampler: Sampler) -> Survey:
    """Read the cloud once, and hand its finite points to the sampler too."""
    facts = Survey()
    if (system := cloud.coordinate_system) is not None:
        facts = Survey(
            name=system.name,
            unit=system.unit,
            vertical_unit=system.vertical_unit,
        )
    by_lower = {name.lower(): name for name in cloud.dimensions}
    wanted = {name: by_lower[name] for name in _READ if name in by_lower}
    last: dict[str, NDArray[Any]] = {}
    for chunk in cloud.chunks(attributes=tuple(wanted.values())):
        real = cloud.lattice.to_coordinates(chunk.points)
        values = {name: chunk.attributes[called] for name, called in wanted.items()}
        _see_places(facts, real, sampler)
        _see_attributes(facts, values)
        valid = finite(real)
        for name, line in (
            ("x", valid[:, 0]),
            ("y", valid[:, 1]),
            ("gps_time", values.get("gps_time")),
        ):
            if line is not None and len(line):
                whole = np.concatenate([last.get(name, line[:0]), line])
                back = int(np.count_nonzero(whole[1:] < whole[:-1]))
                facts.steps_back[name] = facts.steps_back.get(name, 0) + back
                last[name] = line[-1:].copy()
    box = list(zip(facts.low[:2].tolist(), facts.high[:2].tolist(), strict=True))
    judgement = cloud.judged(box if facts.has_extent else None)
    facts.in_degrees, facts.caution = judgement.in_degrees, judgement.caution
    facts.has_lengths_of_unit = not judgement.is_contradicted
    return facts


def _see_places(facts: Survey, real: NDArray[np.float64], sampler: Sampler) -> None:
    valid = finite(real)
    facts.points += len(real)
    facts.invalid += len(real) - len(valid)
    if len(valid):
        facts.low = np.minimum(facts.low, valid.min(axis=0))
        facts.high = np.maximum(facts.high, valid.max(axis=0))
        sampler.see(valid)


def _see_attributes(facts: Survey, values: dict[str, NDArray[Any]]) -> None:
    if (returns := values.get("number_of_returns")) is not None:
        facts.of_many_returns = (facts.of_many_returns or 0) + int(np.count_nonzero(returns > 1))
    if (classes := values.get("classification")) is None or not facts.has_classes:
        return
    if facts.classes is None:
        facts.classes = {}
    found, counts = np.unique(classes[np.isfinite(classes)], return_counts=True)
    is_class = len(found) <= _MOST_CLASSES and bool((found == np.floor(found)).all())
    for number, count in zip(found.tolist(), counts.tolist(), strict=True) if is_class else ():
        facts.classes[int(number)] = facts.classes.get(int(number), 0) + count
    if not is_class or len(facts.classes) > _MOST_CLASSES:
        facts.has_classes = False
        facts.classes = None
