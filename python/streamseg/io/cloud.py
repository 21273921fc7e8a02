"""A point cloud in one or more files, read as one stream of chunks in bounded memory."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from ..errors import FileError, InvalidInput, InvalidParameter, StreamsegWarning, warn
from .coordinate_system import CoordinateSystem, Judgement, judged
from .lattice import Lattice, common_lattice
from .opening import real
from .unchanged import Witness
from .units import ABBREVIATIONS

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

DEFAULT_CHUNK = 250_000


class Chunk(NamedTuple):
    """Consecutive points of a cloud.

    points : (n, 3) float64, C-contiguous, in lattice units (see `Cloud.lattice`)
    attributes : name → (n,) array, one per attribute asked for
    """

    points: NDArray[np.float64]
    attributes: dict[str, NDArray[Any]]


class Source(Protocol):
    """One file of a cloud. `damage` says, after reading, why the end was not reached."""

    path: Path
    kind: str
    point_count: int | None
    lattice: Lattice
    dimensions: tuple[str, ...]
    damage: str | None

    def chunks(self, size: int, attributes: Sequence[str]) -> Iterator[Chunk]:
        """Yield the points in the file's own lattice units."""


class Cloud:
    """One or more files of one kind as a single stream; point ids run on from file to file.

    A cloud can be iterated any number of times and always yields the same points: files that change
    in between are refused (see `streamseg.io.unchanged`).

    Attributes
    ----------
    paths : tuple of Path
    kind : "las", "npy" or "text"
    point_count : int or None
        As the files announce it; None for text. A damaged file yields fewer.
    lattice : Lattice
        Scale and offset that turn the yielded points into coordinates. For LAS the first file's, with a finer
        scale where another file needs it (see `streamseg.io.lattice`); for the other kinds the identity.
    dimensions : tuple of str
        Names that every file has; any of them can be asked for as an attribute.
    extent_x : float or None
        How far the points reach along x, where the files' headers say it.
    coordinate_system : CoordinateSystem or None
        That of the first file that says something of it.
    unit : str or None
        Unit of the horizontal coordinates in short, such as "m", "ft" or "°", where it is known.
    caution : str or None
        One sentence, if distances between the points are not what they seem: coordinates in degrees, mixed units.
    damage : str or None
        After an iteration: one sentence that says which points could not be read.
    """

    def __init__(self, sources: Sequence[Source], witnesses: Sequence[Witness] | None = None) -> None:
        self.sources = tuple(sources)
        self.witnesses = tuple(witnesses or (Witness(source.path) for source in self.sources))
        self.paths = tuple(source.path for source in self.sources)
        self.kind = _one_kind(self.sources)
        counts = [source.point_count for source in self.sources]
        self.point_count = None if None in counts else sum(count or 0 for count in counts)
        if self.point_count == 0:
            raise InvalidInput(f"{_listing(self.paths)} has no points")
        self.lattice, self.shifts = common_lattice([source.lattice for source in self.sources])
        self._warn_of_rounding()
        self._warn_of_odd_company()
        self.dimensions = tuple(
            name for name in self.sources[0].dimensions if all(name in other.dimensions for other in self.sources[1:])
        )
        self.extent_x = _extent_along_x(self.sources)
        self.coordinate_system = _coordinate_system(self.sources)
        unit = self.coordinate_system and self.coordinate_system.unit
        judgement = self.judged()
        self.unit = ABBREVIATIONS.get(unit, unit) if unit and not judgement.is_contradicted else None
        self.caution = judgement.caution
        self.damage: str | None = None

    def chunks(self, size: int = DEFAULT_CHUNK, attributes: Sequence[str] = ()) -> Generator[Chunk, None, None]:
        """Yield the cloud from its first point to its last.

        Parameters
        ----------
        size : int
            Points per chunk, at least 1. The last chunk of each file may be shorter.
        attributes : sequence of str
            Names out of `dimensions`, e.g. ``gps_time``.

        Raises
        ------
        InvalidInput
            An attribute that a file does not have.
        FileError
            Not one point can be read, or a file has changed since it was opened. Damage after the first
            point ends the file and is told in `damage`.
        """
        if size < 1:
            raise InvalidParameter(f"chunk size is {size}, must be 1 or more")
        missing = [name for name in attributes if name not in self.dimensions]
        if missing:
            raise InvalidInput(
                f"{_listing(self.paths)} has no dimension {missing[0]!r}; there are: {', '.join(self.dimensions)}"
            )
        return self._iterate(size, tuple(attributes))

    def _iterate(self, size: int, attributes: tuple[str, ...]) -> Generator[Chunk, None, None]:
        self.damage = None
        seen = 0
        for source, witness, shift in zip(self.sources, self.witnesses, self.shifts, strict=True):
            with witness.reading() as reading:
                for chunk in source.chunks(size, attributes):
                    seen += len(chunk.points)
                    reading.add(chunk.points)
                    shift.apply(chunk.points)
                    yield chunk
                reading.is_damaged = source.damage is not None
            self.note_damage(source)
        if seen == 0:
            raise FileError(self.damage or f"{_listing(self.paths)} has no points")

    def judged(self, box: Sequence[tuple[float, float]] | None = None) -> Judgement:
        """Judge what distances are, by the first file for which there is something to say.

        `box` is the range of x and of y, once all has been read; files that say it in their header are not asked again.
        """
        for source in self.sources:
            own = getattr(source, "coordinate_system", None) or self.coordinate_system
            looks_so = bool(getattr(source, "looks_like_degrees", False))
            said: tuple[tuple[float, float], ...] | None = getattr(source, "box", None)
            judgement = judged(own, said[:2] if said else box, looks_so)
            if judgement.caution:
                return judgement
        return Judgement()

    @property
    def digests(self) -> list[str] | None:
        """The number of points of each file and a checksum of them, once all have been read."""
        digests = [witness.digest for witness in self.witnesses]
        return [digest for digest in digests if digest is not None] if None not in digests else None

    def expect(self, digests: object, origin: str) -> None:
        """Have readings refuse other points than those of these digests: `origin` is of them."""
        if isinstance(digests, list) and len(digests) == len(self.witnesses):
            for witness, digest in zip(self.witnesses, digests, strict=True):
                witness.expect(digest, origin)

    def check_unchanged(self) -> None:
        """Refuse files that have changed since they were opened, as far as the file system says so."""
        for witness in self.witnesses:
            witness.check()

    def note_damage(self, source: Source) -> None:
        """Add what `source` has to say about its damage, once it has been read."""
        if source.damage:
            self.damage = source.damage if self.damage is None else f"{self.damage}; {source.damage}"

    def _warn_of_rounding(self) -> None:
        for source, shift in zip(self.sources, self.shifts, strict=True):
            if not shift.exact:
                steps = ", ".join(f"{scale:g}" for scale in self.lattice.scale)
                warnings.warn(
                    f"{source.path.name} does not lie on the lattice of {self.sources[0].path.name}: its coordinates "
                    f"are rounded to the nearest multiple of ({steps}), a change of at most half of that",
                    StreamsegWarning,
                    stacklevel=4,
                )

    def _warn_of_odd_company(self) -> None:
        """Warn of files that are given twice, and of those whose coordinates or times mean something else."""
        seen: set[Path] = set()
        for source in self.sources:
            if (place := real(source.path)) in seen:
                warn(f"{source.path} is given more than once: its points come as often, all at the same places")
            seen.add(place)
        self._warn_of_systems()
        self._warn_of_clocks()

    def _warn_of_systems(self) -> None:
        """Warn of files whose coordinate systems differ, and of those that say nothing of theirs beside others."""
        stated = [(source.path, getattr(source, "stated_system", None)) for source in self.sources]
        known = [(path, said) for path, said in stated if said]
        silent = [path for path, said in stated if not said]
        for path, said in known[1:]:
            if known[0][1].contradicts(said):
                warn(
                    f"{known[0][0]} and {path} have different coordinate systems, and are segmented as if they had the "
                    "same; bring them into one first"
                )
                return
        if known and silent:
            others = f" and {len(silent) - 1:,} more" if len(silent) > 1 else ""
            warn(f"{silent[0]}{others} names no coordinate system; that of {known[0][0]} is taken for all, and written")

    def _warn_of_clocks(self) -> None:
        """Warn of files that count time from different days."""
        first, clock = self.sources[0], getattr(self.sources[0], "clock", None)
        for source in self.sources[1:]:
            other = getattr(source, "clock", None)
            if clock and other and clock != other:
                warn(
                    f"gps_time of {first.path} is {clock}, that of {source.path} is {other}; they are taken as they are"
                )
                return


def damage_sentence(path: Path, read: int, announced: int, reason: str) -> str:
    """Say how far a damaged file could be read."""
    if read == 0:
        return f"{path} is damaged before its first point: none of its {announced:,} points could be read ({reason})"
    return (
        f"{path.name} is damaged after point {read:,} of {announced:,}; "
        f"the {read:,} points before it were read ({reason})"
    )


def _coordinate_system(sources: Sequence[Source]) -> CoordinateSystem | None:
    systems: list[CoordinateSystem | None] = [getattr(source, "coordinate_system", None) for source in sources]
    return next((system for system in systems if system is not None), None)


def _extent_along_x(sources: Sequence[Source]) -> float | None:
    """How far all files together reach along x, where their headers say it."""
    ranges: list[tuple[float, float] | None] = [getattr(source, "range_x", None) for source in sources]
    known = [each for each in ranges if each is not None]
    if len(known) < len(ranges):
        return None
    return max(high for _, high in known) - min(low for low, _ in known)


def _one_kind(sources: tuple[Source, ...]) -> str:
    if not sources:
        raise InvalidInput("no input file was given, at least one is needed")
    kinds = {source.kind: source.path.name for source in sources}
    if len(kinds) > 1:
        listed = ", ".join(f"{name} is {kind}" for kind, name in kinds.items())
        raise InvalidInput(f"the inputs are of different kinds ({listed}); give files of one kind")
    return sources[0].kind


def _listing(paths: Sequence[Path]) -> str:
    return str(paths[0]) if len(paths) == 1 else f"{paths[0]} (and {len(paths) - 1} more)"
