"""The tables of a history: Parquet parts, written, and read in batches that are checked."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import FileError, InvalidInput, MissingExtra

if TYPE_CHECKING:
    import pyarrow

Ids = NDArray[np.int64]

COLUMNS = {
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

# Rows that are held at a time. Parts of ours are not larger, so each of their tables is one batch.
BATCH_ROWS = 1 << 20
_READ_AHEAD = 1 << 20

# Point ids beyond this are damage.
_MOST_POINTS = 2**40
_BLOCK_BITS = 20


def parquet() -> Any:
    """Import what reads and writes Parquet."""
    try:
        import pyarrow.parquet
    except ImportError:
        raise MissingExtra("a history is kept as Parquet; install it with: pip install 'streamseg[history]'") from None
    return pyarrow.parquet


def part_path(folder: Path, table: str, part: int) -> Path:
    """Name the file of one part of a table."""
    return folder / table / f"part-{part:06}.parquet"


def schema(table: str) -> pyarrow.Schema:
    """Make the schema of a table: all columns are int64, and none of their values is missing."""
    import pyarrow

    return pyarrow.schema([(name, pyarrow.int64()) for name in COLUMNS[table]])


def write_part(folder: Path, table: str, part: int, rows: Ids) -> None:
    """Write rows as one part of a table."""
    import pyarrow

    columns = COLUMNS[table]
    arrays = {name: np.ascontiguousarray(rows[:, i]) for i, name in enumerate(columns)}
    # Ids of neighbouring rows differ little: deltas are smaller, and faster to write, than anything else.
    parquet().write_table(
        pyarrow.table(arrays),
        part_path(folder, table, part),
        compression="zstd",
        use_dictionary=False,
        column_encoding=dict.fromkeys(columns, "DELTA_BINARY_PACKED"),
        write_page_checksum=True,
    )


def read_part(folder: Path, table: str, part: int, columns: int | None = None) -> Iterator[list[Ids]]:
    """Read the first columns of a part, or all, batch by batch, however long it is.

    Raises
    ------
    FileError
        The part is not there, or damaged.
    """
    for batch in record_batches(folder, table, part, columns):
        yield [column.to_numpy() for column in batch.columns]


def record_batches(folder: Path, table: str, part: int, columns: int | None = None) -> Iterator[pyarrow.RecordBatch]:
    """Do the same, with batches as Parquet's reader has them."""
    reader, names, path = parquet(), COLUMNS[table][:columns], part_path(folder, table, part)
    import pyarrow

    try:
        with reader.ParquetFile(
            path, buffer_size=_READ_AHEAD, pre_buffer=False, page_checksum_verification=True
        ) as file:
            _check_columns(file.schema_arrow, names)
            for batch in file.iter_batches(BATCH_ROWS, columns=list(names), use_threads=False):
                for name, column in zip(names, batch.columns, strict=True):
                    if column.null_count:
                        raise ValueError(f"{name} has rows without a value")
                yield batch
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise FileError(f"{path} cannot be read, the history is damaged: {reason}") from error


def _check_columns(fields: pyarrow.Schema, names: tuple[str, ...]) -> None:
    for name in names:
        if len(fields.get_all_field_indices(name)) != 1:
            raise ValueError(f"it has no column {name}, or several")
        if str(kind := fields.field(name).type) != "int64":
            raise ValueError(f"column {name} is {kind}, expected int64")


class PointsSeen:
    """Which point ids have been told of: a bit for each, on disk, so that none is told twice.

    Parameters
    ----------
    folder : Path
        The history, for messages.
    points : int
        How many points there are.
    is_whole : bool
        Whether all of them are told of: then their ids are below that number.
    """

    def __init__(self, folder: Path, points: int, is_whole: bool) -> None:
        self._folder = folder
        self._end = points if is_whole else _MOST_POINTS
        try:
            self._bits: IO[bytes] = tempfile.TemporaryFile(prefix="streamseg-")  # noqa: SIM115 - see close
        except OSError as error:
            raise FileError(f"cannot make a temporary file in {tempfile.gettempdir()}: {error.strerror}") from error
        self.points = 0
        """How many have been told of."""

    def add(self, point_ids: Ids) -> None:
        """Note points.

        Raises
        ------
        InvalidInput
            One of them cannot be, or has been told of before.
        """
        if not len(point_ids):
            return
        ids = point_ids if (point_ids[1:] > point_ids[:-1]).all() else np.sort(point_ids)
        for odd in (ids[0], ids[-1]):
            if not 0 <= odd < self._end:
                raise InvalidInput(
                    f"the history is damaged: the parts in {self._folder} tell of point {odd}, "
                    f"allowed: from 0 to below {self._end:,}"
                )
        self._refuse(ids[1:][ids[1:] == ids[:-1]])
        blocks = np.flatnonzero(np.diff(ids >> _BLOCK_BITS)) + 1
        for block in np.split(ids, blocks):
            self._add_block(block)
        self.points += len(ids)

    def close(self) -> None:
        """Remove what is on disk."""
        self._bits.close()

    def _add_block(self, ids: Ids) -> None:
        start, stop = int(ids[0]) >> 3, (int(ids[-1]) >> 3) + 1
        new = np.zeros(8 * (stop - start), np.bool_)
        new[ids - 8 * start] = True
        self._bits.seek(start)
        before = np.frombuffer(self._bits.read(stop - start).ljust(stop - start, b"\0"), np.uint8)
        packed = np.packbits(new)
        if (twice := np.flatnonzero(np.unpackbits(before & packed))).size:
            self._refuse(twice + 8 * start)
        self._bits.seek(start)
        try:
            self._bits.write((before | packed).tobytes())
            self._bits.flush()
        except OSError as error:
            raise FileError(
                f"cannot write into {tempfile.gettempdir()}: {error.strerror}; make room there or set TMPDIR"
            ) from error

    def _refuse(self, twice: Ids) -> None:
        if len(twice):
            raise InvalidInput(
                f"the history is damaged: the parts in {self._folder} tell of point {twice[0]} more than once"
            )
