"""The history of a run: a folder that keeps the whole story of points and segments.

``manifest.json`` says what was done. ``point_segment/`` holds the raw segment id of every point, ``segment_segment/``
every successor of every segment, ``window/`` the windows, ``alias/`` the late joins of a run that carried ids, and
``seedless/`` the segments that hold no seed, where seeds were asked for. All are Parquet, in parts with equal numbers:
what went out of scope together is in parts of the same number. Only a span with more points than a part holds takes
several parts: its windows and points first, then what is told of segments.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from ._core import Replay, Settlement
from .errors import FileError, InvalidInput, InvalidParameter
from .history_folder import (
    COUNTS,
    FORMAT,
    FORMAT_VERSION,
    MANIFEST,
    UNFINISHED_MANIFEST,
    check_free,
    discard,
    prepare,
    read_manifest,
    shown,
)
from .history_tables import COLUMNS, Ids, PointsSeen, parquet, read_part, record_batches, write_part
from .io.home import Home
from .io.opening import there
from .io.output import check_file, refuse_pattern, replacing
from .unlabelled import Unlabelled

if TYPE_CHECKING:
    from ._core import Span as CoreSpan

__all__ = ["MANIFEST", "History", "HistoryWriter", "Part", "check_free"]

# Rows in a part. A run that is killed loses the part under way, no more.
_ROWS_PER_PART = 1_000_000

# Windows say which ids there are, so a history that ends early has them. What is told of points comes before what is
# told of their segments.
_TABLES_IN_ORDER = ("window", "point_segment", "seedless", "segment_segment", "alias")

_NONE = np.empty(0, np.int64)


class HistoryWriter:
    """Writes a history while a stream runs, as the only one that writes in its folder."""

    def __init__(
        self, folder: Path, *, source: str, parameters: dict[str, Any], promise: str, overwrite: bool = False
    ) -> None:
        self._folder = folder
        self._held = prepare(folder, overwrite)
        # Columns of the rows of each table.
        self._waiting: dict[str, list[list[Ids]]] = {table: [] for table in COLUMNS}
        self._waiting_rows = 0
        self._next_span = 0
        # Of spans with rows that wait: they count with the last of these.
        self._waiting_unlabelled = Unlabelled()
        self._waiting_late_joins = 0
        self._home = Home(f"the writing of the history {folder}")
        self.is_kept_empty = True
        """Whether the folder stays if the run fails before the first span."""
        self._manifest: dict[str, Any] = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "source": source,
            "parameters": parameters,
            "promise": promise,
            "complete": False,
            **dict.fromkeys(COUNTS, 0),
            "unlabelled": Unlabelled()._asdict(),
        }
        self._write_manifest(self._manifest)

    def write(self, span: CoreSpan, *, with_aliases: bool) -> None:
        """Take in a span that went out of scope. A span is taken in once, however often it is given."""
        self._home.check()
        if span.index >= self._next_span:
            self._wait("point_segment", span.point_ids, span.raw_ids, span.index)
            self._wait("segment_segment", *span.segments.T)
            self._wait("window", *span.windows.T)
            self._wait("seedless", span.seedless, span.index)
            if with_aliases:
                self._wait("alias", *span.aliases.T, span.index)
            self._waiting_unlabelled = self._waiting_unlabelled.with_more(span.unlabelled)
            self._waiting_late_joins += span.late_joins
            # A span without points is a row of its own: there may be any number of them.
            self._waiting_rows += 1
            self._next_span = span.index + 1
        while self._waiting_rows >= _ROWS_PER_PART:
            self._write_part(complete=False)

    def close(
        self, *, complete: bool, certificate: dict[str, int] | None = None, digests: list[str] | None = None
    ) -> None:
        """Write what waits and the manifest, with what the run could prove, and which points the files had.

        In a forked child it does nothing.
        """
        if not self._home.is_here:
            return
        if not (complete or self.is_kept_empty or self._next_span):
            discard(self._folder, self._held)
            return
        if digests is not None:
            self._manifest["digests"] = digests
        if certificate is not None:
            self._manifest["certificate"] = certificate
        while self._waiting_rows >= 2 * _ROWS_PER_PART:
            self._write_part(complete=False)
        self._write_part(complete=complete)
        self._held.release()

    def _wait(self, table: str, *columns: Ids | int) -> None:
        rows = np.broadcast_arrays(*columns)
        if len(rows[0]):
            self._waiting[table].append(list(rows))
            self._waiting_rows += len(rows[0])

    def _write_part(self, *, complete: bool) -> None:
        """Write what waits as one part; it counts, and waits no more, when all of it is on disk."""
        part = self._manifest["parts"]
        # What goes out of scope together stays together, unless it alone is more than a part should hold.
        room = _ROWS_PER_PART if self._waiting_rows >= 2 * _ROWS_PER_PART else self._waiting_rows
        tables, waiting = _divided(self._waiting, room)
        try:
            for table, rows in tables.items():
                write_part(self._folder, table, part, rows)
        except OSError as error:
            self._held.release()
            raise FileError(f"the history {self._folder} cannot be written: {error}") from error
        rows_waiting = sum(len(rows[0]) for table in waiting.values() for rows in table)
        manifest = {
            **self._manifest,
            "complete": complete,
            "points": self._manifest["points"] + len(tables["point_segment"]),
            "windows": self._manifest["windows"] + len(tables["window"]),
            "parts": part + 1,
        }
        if len(tables["window"]):
            last = dict(zip(COLUMNS["window"], tables["window"][-1].tolist(), strict=True))
            manifest["segment_ids"] = last["first_segment_id"] + last["segments"] - 1
        if rows_waiting == 0:
            unlabelled = Unlabelled(**self._manifest["unlabelled"]).with_more(self._waiting_unlabelled._asdict())
            manifest |= {"spans": self._next_span, "unlabelled": unlabelled._asdict()}
        late_joins = 0
        if rows_waiting == 0 or len(tables["segment_segment"]):
            # Who reads rows of late joins has to expect them.
            late_joins = self._waiting_late_joins
            manifest["late_joins"] = self._manifest["late_joins"] + late_joins
        self._write_manifest(manifest)
        self._manifest = manifest
        self._waiting, self._waiting_rows = waiting, rows_waiting
        self._waiting_late_joins -= late_joins
        if rows_waiting == 0:
            self._waiting_unlabelled = Unlabelled()

    def _write_manifest(self, manifest: dict[str, Any]) -> None:
        unfinished = self._folder / UNFINISHED_MANIFEST
        try:
            unfinished.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
            unfinished.replace(self._folder / MANIFEST)
        except OSError as error:
            self._held.release()
            raise FileError(f"the history {self._folder} cannot be written: {error}") from error


def _divided(waiting: dict[str, list[list[Ids]]], room: int) -> tuple[dict[str, Ids], dict[str, list[list[Ids]]]]:
    """Divide rows that wait into those of a part, with room for so many, and those that wait on."""
    part: dict[str, Ids] = {}
    rest: dict[str, list[list[Ids]]] = {}
    for table in _TABLES_IN_ORDER:
        taken: list[Ids] = [np.empty((0, len(COLUMNS[table])), np.int64)]
        rest[table] = []
        for columns in waiting[table]:
            stop = min(room, len(columns[0]))
            if table == "segment_segment" and 0 < stop < len(columns[0]):
                # All that is told of a segment is in one part.
                others = np.flatnonzero(columns[0][stop:] != columns[0][stop - 1])
                stop = stop + int(others[0]) if len(others) else len(columns[0])
            if stop:
                taken.append(np.column_stack([column[:stop] for column in columns]))
            if stop < len(columns[0]):
                rest[table].append([column[stop:] for column in columns])
            room = max(0, room - stop)
        part[table] = np.concatenate(taken)
    return part, rest


class Part(NamedTuple):
    """A piece of what went out of scope together."""

    point_ids: Ids
    raw_ids: Ids
    segment_ids: Ids
    next_segment_ids: Ids
    seedless: Ids


class History:
    """A history on disk.

    Parameters
    ----------
    folder : path
        As given to `stream` or ``streamseg segment --history``.

    Raises
    ------
    FileError
        If there is no history in the folder.
    InvalidInput
        If it is damaged, or of another format version.

    Examples
    --------
    >>> import numpy as np, streamseg as ss, tempfile
    >>> folder = tempfile.mkdtemp()
    >>> with ss.stream(np.zeros((5, 3)), ss.Proximity(1.0), history=folder) as run:
    ...     _ = list(run)
    >>> ss.History(folder).manifest["points"]
    5
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_manifest(self.folder)
        # What the last `resolve` came to: segments kept; by cause, segments left out and their points.
        self.selected: tuple[int, dict[str, int], dict[str, int]] = (0, {}, {})

    @property
    def unlabelled(self) -> Unlabelled:
        """How many points have no raw segment, by cause; of an earlier version's history nothing is known."""
        return Unlabelled().with_more(self.manifest.get("unlabelled", {}))

    def parts(self) -> Iterator[Part]:
        """Read the history in the order in which it was written, in pieces of bounded size.

        What is told of the points of a part comes first, then what is told of their segments.
        """
        for part in range(self.manifest["parts"]):
            for point_ids, raw_ids in read_part(self.folder, "point_segment", part, 2):
                yield Part(point_ids, raw_ids, _NONE, _NONE, _NONE)
            for (seedless,) in read_part(self.folder, "seedless", part, 1):
                yield Part(_NONE, _NONE, _NONE, _NONE, seedless)
            for segment_ids, next_segment_ids in _by_segment(read_part(self.folder, "segment_segment", part, 2)):
                yield Part(_NONE, _NONE, segment_ids, next_segment_ids, _NONE)

    def resolve(self, *, limits: bool = True) -> Iterator[tuple[Ids, Ids]]:
        """Turn the raw ids of all points into final ids, in bounded memory.

        There are two sweeps. Forwards, ids are carried as the segments' successors are told, and points are counted.
        Backwards, ids are settled.

        Parameters
        ----------
        limits : bool, default True
            Whether the run's limits of size, seeds and order apply; the manifest has them. What they leave out becomes
            -1. Without, the points of segments that are too small can be found. Numbering by size takes 16 bytes of
            memory for each segment that is kept.

        Yields
        ------
        (n,) int64, (n,) int64
            Point ids and their final segment ids, part by part.

        Raises
        ------
        FileError, InvalidInput
            If the history is damaged; before anything is yielded.
        """
        self._check_windows()
        replay = Replay(self.manifest["segment_ids"], late_joins=self.manifest["late_joins"] > 0)
        settlement = Settlement(with_points=False)
        points, is_whole = self.manifest["points"], self.manifest["complete"]
        with closing(PointsSeen(self.folder, points, is_whole)) as seen:
            for index, part in enumerate(self.parts()):
                seen.add(part.point_ids)
                carried, position = replay.part(part.segment_ids, part.next_segment_ids, part.seedless, part.raw_ids)
                if len(part.point_ids):
                    settlement.keep_ids(index, part.point_ids, carried, position)
        self._check_count("points", seen.points)
        if not points:
            # Even then something comes, to be put together with nothing.
            settlement.keep_ids(0, _NONE, *replay.part(_NONE, _NONE, _NONE, _NONE))
        self.selected = self._settle(replay, settlement, limits)
        for settled in settlement:
            yield settled.point_ids, settled.segment_ids

    def _check_windows(self) -> None:
        """Refuse segment ids that no window can have given: memory is taken for all of them."""
        windows = segment_ids = 0
        most = self.manifest["points"] if self.manifest["complete"] else np.iinfo(np.int64).max
        for part in range(self.manifest["parts"]):
            for batch in read_part(self.folder, "window", part):
                rows = dict(zip(COLUMNS["window"], batch, strict=True))
                windows += len(rows["window"])
                points, segments = rows["points"], rows["segments"]
                if ((segments < 0) | (segments > points) | (points > most)).any():
                    raise InvalidInput(
                        f"the history is damaged: a window in {self.folder} has more segments or points than can be"
                    )
                segment_ids += int(segments.sum())
        self._check_count("windows", windows)
        self._check_count("segment_ids", segment_ids)

    def _check_count(self, of: str, rows: int) -> None:
        if rows != self.manifest[of]:
            raise InvalidInput(
                f"the history is damaged: the parts in {self.folder} hold {rows:,} {of}, "
                f"the manifest says {self.manifest[of]:,}"
            )

    def _settle(
        self, replay: Replay, settlement: Settlement, limits: bool
    ) -> tuple[int, dict[str, int], dict[str, int]]:
        if not limits:
            return replay.settle(settlement)
        kept = tuple(
            self.manifest["parameters"].get(option) for option in ("min_segment_size", "max_segment_size", "sort")
        )
        try:
            return replay.settle(settlement, kept)
        except (TypeError, OverflowError, InvalidParameter) as error:
            path = self.folder / MANIFEST
            raise InvalidInput(f"{path} is damaged: its limits of size are {shown(kept)}") from error

    def to_csv(self, folder: str | Path, *, overwrite: bool = False) -> list[Path]:
        """Write each table as one CSV file with a header line; returns the files.

        They appear when all of them are written. The folder is made; the folder it is in must be there.
        """
        parquet()
        folder = Path(folder)
        refuse_pattern(folder, "folder")
        is_new = there(folder) is None
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise FileError(f"{folder} cannot be made: {error.strerror}") from error
        paths = {table: folder / f"{table}.csv" for table in COLUMNS}
        try:
            for table, path in paths.items():
                check_file(path, [], overwrite, "table", partial(_foreign_csv, table=table))
            with ExitStack() as files:
                for table, path in paths.items():
                    self._write_csv(table, files.enter_context(replacing(path, overwrite=overwrite)))
        except BaseException:
            if is_new:
                with suppress(OSError):
                    folder.rmdir()
            raise
        return list(paths.values())

    def _write_csv(self, table: str, file: BinaryIO) -> None:
        import pyarrow.csv

        file.write(_csv_header(table))
        written = 0
        for part in range(self.manifest["parts"]):
            for batch in record_batches(self.folder, table, part):
                lines = pyarrow.BufferOutputStream()
                pyarrow.csv.write_csv(batch, lines, pyarrow.csv.WriteOptions(include_header=False))
                file.write(lines.getvalue())
                written += len(batch)
        if (of := {"point_segment": "points", "window": "windows"}.get(table)) is not None:
            self._check_count(of, written)


def _csv_header(table: str) -> bytes:
    return (",".join(f'"{name}"' for name in COLUMNS[table]) + "\n").encode()


def _foreign_csv(path: Path, table: str) -> str | None:
    """Say what a file is that is not this table; None if it may be replaced."""
    header = _csv_header(table)
    with open(path, "rb") as file:
        return None if file.read(len(header)) in (header, b"") else "no table of a history"


def _by_segment(batches: Iterator[list[Ids]]) -> Iterator[list[Ids]]:
    """Keep rows of one segment together: a segment is forgotten when it has been told of."""
    held = [_NONE, _NONE]
    for batch in batches:
        rows = [np.concatenate(columns) for columns in zip(held, batch, strict=True)]
        others = np.flatnonzero(rows[0] != rows[0][-1])
        stop = int(others[-1]) + 1 if len(others) else 0
        yield [column[:stop] for column in rows]
        held = [column[stop:] for column in rows]
    yield held
