"""The history of a run: a folder that keeps the whole story of points and segments.

``manifest.json`` says what was done. ``point_segment/`` holds the raw segment id of every point, ``segment_segment/``
every successor of every segment, ``window/`` the windows, ``alias/`` the late joins of a run that carried ids, and
``seedless/`` the segments that hold no seed, where seeds were asked for. All are Parquet, in parts with equal numbers:
what went out of scope together is in parts of the same number.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._core import Replay, Settlement
from .errors import FileError, InvalidInput, InvalidParameter, MissingExtra, OutputExists
from .unlabelled import Unlabelled

if TYPE_CHECKING:
    import pyarrow

    from ._core import Span as CoreSpan

FORMAT_VERSION = 1
MANIFEST = "manifest.json"

_COLUMNS = {
    "point_segment": ("point_id", "segment_id", "span"),
    "segment_segment": ("segment_id", "next_segment_id", "window", "shared_points"),
    "window": (
        *("window", "first_span", "spans", "points", "first_segment_id", "segments"),
        *("decided_edges", "waiting_edges", "decided_points", "waiting_points"),
        *("returned_points", "early_decisions"),
    ),
    "alias": ("segment_id", "becomes", "span"),
    "seedless": ("segment_id", "span"),
}

# Counts beyond this are damage.
_MOST = 2**53

# Rows of the point-segment table in a part. A run that is killed loses the part under way, no more.
_ROWS_PER_PART = 1_000_000


def _parquet() -> Any:
    try:
        import pyarrow.parquet
    except ImportError:
        raise MissingExtra("a history is kept as Parquet; install it with: pip install 'streamseg[history]'") from None
    return pyarrow.parquet


class HistoryWriter:
    """Writes a history while a stream runs."""

    def __init__(
        self, folder: Path, *, source: str, parameters: dict[str, Any], promise: str, overwrite: bool = False
    ) -> None:
        self._parquet = _parquet()
        self._folder = folder
        check_free(folder, overwrite)
        _prepare(folder)
        self._waiting: dict[str, list[NDArray[np.int64]]] = {table: [] for table in _COLUMNS}
        self._waiting_rows = 0
        self._next_span = 0
        self._manifest: dict[str, Any] = {
            "format": "streamseg history",
            "version": FORMAT_VERSION,
            "source": source,
            "parameters": parameters,
            "promise": promise,
            "complete": False,
            "points": 0,
            "spans": 0,
            "windows": 0,
            "segment_ids": 0,
            "late_joins": 0,
            "parts": 0,
            "unlabelled": Unlabelled()._asdict(),
        }
        self._write_manifest(self._manifest)

    def write(self, span: CoreSpan, *, with_aliases: bool) -> None:
        """Take in a span that went out of scope. A span is taken in once, however often it is given."""
        if span.index >= self._next_span:
            spans = np.full(len(span.point_ids), span.index, np.int64)
            self._waiting["point_segment"].append(np.column_stack([span.point_ids, span.raw_ids, spans]))
            self._waiting["segment_segment"].append(span.segments)
            self._waiting["window"].append(span.windows)
            self._manifest["late_joins"] += span.late_joins
            unlabelled = Unlabelled(**self._manifest["unlabelled"]).with_more(span.unlabelled)
            self._manifest["unlabelled"] = unlabelled._asdict()
            if with_aliases:
                told = np.full(len(span.aliases), span.index, np.int64)
                self._waiting["alias"].append(np.column_stack([span.aliases, told]))
            told = np.full(len(span.seedless), span.index, np.int64)
            self._waiting["seedless"].append(np.column_stack([span.seedless, told]))
            # A span without points is a row of its own: there may be any number of them.
            self._waiting_rows += 1 + len(spans) + len(span.segments)
            self._next_span = span.index + 1
        if self._waiting_rows >= _ROWS_PER_PART:
            self._write_part(complete=False)

    def close(self, *, complete: bool, certificate: dict[str, int] | None = None) -> None:
        """Write what waits and the manifest, with what the run could prove."""
        if certificate is not None:
            self._manifest["certificate"] = certificate
        self._write_part(complete=complete)

    def _write_part(self, *, complete: bool) -> None:
        """Write what waits as one part; it counts, and waits no more, when all of it is on disk."""
        part = self._manifest["parts"]
        tables = {
            table: np.concatenate([np.empty((0, len(columns)), np.int64), *self._waiting[table]])
            for table, columns in _COLUMNS.items()
        }
        for table, rows in tables.items():
            self._write_rows(table, part, rows)
        manifest = {
            **self._manifest,
            "complete": complete,
            "points": self._manifest["points"] + len(tables["point_segment"]),
            "spans": self._next_span,
            "windows": self._manifest["windows"] + len(tables["window"]),
            "parts": part + 1,
        }
        if len(tables["window"]):
            last = dict(zip(_COLUMNS["window"], tables["window"][-1].tolist(), strict=True))
            manifest["segment_ids"] = last["first_segment_id"] + last["segments"] - 1
        self._write_manifest(manifest)
        self._manifest = manifest
        self._waiting = {table: [] for table in _COLUMNS}
        self._waiting_rows = 0

    def _write_rows(self, table: str, part: int, rows: NDArray[np.int64]) -> None:
        import pyarrow

        path, columns = self._folder / table / f"part-{part:06}.parquet", _COLUMNS[table]
        arrays = {name: np.ascontiguousarray(rows[:, i]) for i, name in enumerate(columns)}
        try:
            # Ids of neighbouring rows differ little: deltas are smaller, and faster to write, than anything else.
            self._parquet.write_table(
                pyarrow.table(arrays),
                path,
                compression="zstd",
                use_dictionary=False,
                column_encoding=dict.fromkeys(columns, "DELTA_BINARY_PACKED"),
            )
        except OSError as error:
            raise FileError(f"the history {self._folder} cannot be written: {error}") from error

    def _write_manifest(self, manifest: dict[str, Any]) -> None:
        path = self._folder / MANIFEST
        try:
            path.with_suffix(".part").write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
            path.with_suffix(".part").replace(path)
        except OSError as error:
            raise FileError(f"the history {self._folder} cannot be written: {error}") from error


def check_free(folder: Path, overwrite: bool) -> None:
    """Refuse a folder that is something else, or a history that is not to be replaced; and any without pyarrow."""
    _parquet()
    try:
        is_history = (folder / MANIFEST).is_file()
        if not is_history and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise OutputExists(f"{folder} exists and is no history; give another folder for the history")
        if is_history and not overwrite:
            raise OutputExists(f"the history {folder} exists; give another folder, or overwrite=True (--overwrite)")
    except OutputExists:
        raise
    except OSError as error:
        raise FileError(f"the history {folder} cannot be made: {error.strerror}") from error


def _prepare(folder: Path) -> None:
    """Make the folders, empty."""
    try:
        for table in _COLUMNS:
            shutil.rmtree(folder / table, ignore_errors=True)
            (folder / table).mkdir(parents=True)
    except OSError as error:
        raise FileError(f"the history {folder} cannot be made: {error.strerror}") from error


class Part(NamedTuple):
    """What went out of scope together."""

    point_ids: NDArray[np.int64]
    raw_ids: NDArray[np.int64]
    segment_ids: NDArray[np.int64]
    next_segment_ids: NDArray[np.int64]
    seedless: NDArray[np.int64]


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
        If it was written by a newer version.

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
        path = self.folder / MANIFEST
        try:
            text = path.read_bytes()
        except OSError:
            raise FileError(f"{self.folder} is no history: it has no {MANIFEST}") from None
        try:
            manifest = json.loads(text)
            version = manifest["version"]
        except (ValueError, KeyError, TypeError):
            raise InvalidInput(f"{path} is damaged: it is no manifest of a history") from None
        if version != FORMAT_VERSION:
            raise InvalidInput(f"{self.folder} has format version {version}, this version reads {FORMAT_VERSION}")
        if not isinstance(manifest.get("parameters"), dict):
            raise InvalidInput(f"{path} is damaged: it has no parameters")
        for count in ("points", "spans", "windows", "segment_ids", "late_joins", "parts"):
            if not isinstance(manifest.get(count), int) or not 0 <= manifest[count] < _MOST:
                raise InvalidInput(f"{path} is damaged: {count} is {manifest.get(count)!r}, expected a count")
        self.manifest: dict[str, Any] = manifest
        # What the last `resolve` came to: segments kept; by cause, segments left out and their points.
        self.selected: tuple[int, dict[str, int], dict[str, int]] = (0, {}, {})

    @property
    def unlabelled(self) -> Unlabelled:
        """How many points have no raw segment, by cause; of an earlier version's history nothing is known."""
        told = self.manifest.get("unlabelled")
        known = told.items() if isinstance(told, dict) else ()
        counts = {cause: count for cause, count in known if isinstance(count, int)}
        return Unlabelled().with_more(counts)

    def parts(self) -> Iterator[Part]:
        """Read the history part by part, in the order in which it was written."""
        for part in range(self.manifest["parts"]):
            points = self._read("point_segment", part)
            segments = self._read("segment_segment", part)
            yield Part(
                points["point_id"],
                points["segment_id"],
                segments["segment_id"],
                segments["next_segment_id"],
                self._read("seedless", part)["segment_id"],
            )

    def resolve(self, *, limits: bool = True) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Turn the raw ids of all points into final ids, in bounded memory.

        Two sweeps: forwards, ids are carried as the segments' successors are told, and points are counted; backwards,
        they are settled.

        Parameters
        ----------
        limits : bool, default True
            Whether the limits of size, the seeds and the order that the run had (they are in the manifest) apply: what
            they leave out becomes -1. Without, the points of segments that are too small can be found. Numbering by
            size takes 16 bytes of memory for each segment that is kept.

        Yields
        ------
        (n,) int64, (n,) int64
            Point ids and their final segment ids, part by part.

        Raises
        ------
        FileError, InvalidInput
            If the history is damaged; before anything is yielded.
        """
        replay = Replay(self.manifest["segment_ids"], late_joins=self.manifest["late_joins"] > 0)
        settlement = Settlement(with_points=False)
        points = 0
        for index, part in enumerate(self.parts()):
            points += len(part.point_ids)
            carried, position = replay.part(part.segment_ids, part.next_segment_ids, part.seedless, part.raw_ids)
            settlement.keep_ids(index, part.point_ids, carried, position)
        if points != self.manifest["points"]:
            raise InvalidInput(
                f"the history is damaged: the parts in {self.folder} hold {points:,} points, "
                f"the manifest says {self.manifest['points']:,}"
            )
        self.selected = self._settle(replay, settlement, limits)
        for settled in settlement:
            yield settled.point_ids, settled.segment_ids

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
            raise InvalidInput(f"{self.folder / MANIFEST} is damaged: its limits of size are {kept}") from error

    def to_csv(self, folder: str | Path, *, overwrite: bool = False) -> list[Path]:
        """Write each table as one CSV file with a header line; returns the files."""
        _parquet()
        import pyarrow.csv

        written = []
        for table in _COLUMNS:
            path = Path(folder) / f"{table}.csv"
            if path.exists() and not overwrite:
                raise OutputExists(f"{path} exists; give another folder, or overwrite=True (--overwrite)")
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                with pyarrow.csv.CSVWriter(path, self._schema(table)) as writer:
                    for part in range(self.manifest["parts"]):
                        writer.write(self._table(table, part))
            except OSError as error:
                raise FileError(f"{path} cannot be written: {error}") from error
            written.append(path)
        return written

    def _schema(self, table: str) -> pyarrow.Schema:
        import pyarrow

        return pyarrow.schema([(name, pyarrow.int64()) for name in _COLUMNS[table]])

    def _table(self, table: str, part: int) -> pyarrow.Table:
        parquet = _parquet()
        import pyarrow

        path = self.folder / table / f"part-{part:06}.parquet"
        try:
            return parquet.read_table(path).select(_COLUMNS[table]).cast(self._schema(table))
        except (OSError, KeyError, pyarrow.ArrowException) as error:
            raise FileError(f"{path} cannot be read, the history is damaged: {error}") from error

    def _read(self, table: str, part: int) -> dict[str, NDArray[np.int64]]:
        rows = self._table(table, part)
        return {name: rows[name].to_numpy() for name in _COLUMNS[table]}
