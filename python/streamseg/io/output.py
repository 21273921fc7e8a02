"""Files that appear complete or not at all."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast
from uuid import uuid4

from ..errors import FileError, InvalidParameter, OutputExists
from .home import Home, abandon
from .text import SUFFIXES as TEXT_SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# Readers take a file of such a name for a cloud-optimized one, with an octree.
_COPC_SUFFIX = ".copc.laz"

OUTPUT_SUFFIXES = (".las", ".laz", ".npy", *TEXT_SUFFIXES)


def check_output(out: Path | str, inputs: Sequence[Path | str], overwrite: bool = False) -> None:
    """Refuse an output that cannot or must not be written, before any work is done.

    Parameters
    ----------
    out : Path or str
        The file to write: ``.las``, ``.laz``, ``.npy`` or text.
    inputs : sequence of Path or str
        Files that must not be overwritten.
    overwrite : bool
        Whether `out` may replace a file that is there.

    Raises
    ------
    InvalidParameter
        Unknown suffix, or `out` is one of the inputs.
    OutputExists
        `out` is there and `overwrite` is False.
    FileError
        The folder is missing or cannot be written to, or `out` is a folder.
    """
    out = Path(out)
    if out.suffix.lower() not in OUTPUT_SUFFIXES:
        raise InvalidParameter(f"output {out} ends in {out.suffix!r}, must end in {', '.join(OUTPUT_SUFFIXES)}")
    if out.name.lower().endswith(_COPC_SUFFIX):
        plain = out.name[: -len(_COPC_SUFFIX)] + out.suffix
        raise InvalidParameter(f"output {out} is called as COPC is, which is not written; name it {plain}")
    if not out.parent.is_dir():
        raise FileError(f"cannot write {out}: the folder {out.parent} does not exist")
    if out.is_dir():
        raise FileError(f"cannot write {out}: it is a folder")
    if out.exists():
        for path in inputs:
            if Path(path).exists() and out.samefile(path):
                raise InvalidParameter(f"output {out} is the input {path}; give the output another name")
        if not overwrite:
            raise OutputExists(f"{out} exists already; give another name, or overwrite=True (--overwrite)")
    if not os.access(out.parent, os.W_OK | os.X_OK):
        raise FileError(f"cannot write {out}: no permission to write into the folder {out.parent.resolve()}")


@contextmanager
def replacing(out: Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside `out` that takes its name at the end, or is removed when anything fails.

    Raises
    ------
    FileError
        The file cannot be written, e.g. because the disk is full.
    """
    part = out.with_name(f".streamseg-{uuid4().hex}.part")
    guard: _ErrorKeeper | None = None
    home = Home(f"the writing of {out}")
    try:
        with open(part, "x+b") as file:
            guard = _ErrorKeeper(file)
            try:
                yield cast("BinaryIO", guard)
            finally:
                if not home.is_here:
                    abandon(file)
        home.check()
        part.replace(out)
    except BaseException as error:
        if not home.is_here:
            raise
        with suppress(OSError):
            part.unlink(missing_ok=True)
        # Encoders in Rust report a failed write without its cause; the file remembers it.
        cause = guard.error if guard is not None and guard.error is not None else error
        if isinstance(cause, OSError) and not isinstance(cause, FileError) and isinstance(error, Exception):
            raise FileError(
                f"cannot write {out}: {cause.strerror or cause}; nothing half-written is left in {out.parent.resolve()}"
            ) from error
        raise


class _ErrorKeeper:
    """A file that remembers why writing failed."""

    def __init__(self, file: BinaryIO) -> None:
        self._file: Any = file
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            count: int = self._file.write(data)
        except OSError as error:
            self.error = error
            raise
        return count

    def flush(self) -> None:
        try:
            self._file.flush()
        except OSError as error:
            self.error = error
            raise

    def seek(self, offset: int, whence: int = 0) -> int:
        try:
            position: int = self._file.seek(offset, whence)
        except OSError as error:
            self.error = error
            raise
        return position

    def tell(self) -> int:
        position: int = self._file.tell()
        return position
