"""Files that appear complete or not at all, and replace nothing but what they may."""

from __future__ import annotations

import os
import stat
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from ..errors import FileError, InvalidParameter, OutputExists
from .claims import Claim, claim_part
from .earlier import foreign, is_like_inputs
from .home import Home, abandon
from .labels import SEGMENT_DIMENSION
from .opening import is_folder, is_pattern, real, there
from .text import SUFFIXES as TEXT_SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

# Readers take a file of such a name for a cloud-optimized one, with an octree.
_COPC_SUFFIX = ".copc.laz"

OUTPUT_SUFFIXES = (".las", ".laz", ".npy", *TEXT_SUFFIXES)


def check_output(
    out: Path | str, inputs: Sequence[Path | str], overwrite: bool = False, id_name: str | None = None
) -> None:
    """Refuse an output that cannot or must not be written, before any work is done.

    Parameters
    ----------
    out : Path or str
        The file to write: ``.las``, ``.laz``, ``.npy`` or text.
    inputs : sequence of Path or str
        Files that must not be overwritten.
    overwrite : bool
        Whether `out` may replace a file that is there. A cloud, array or text that streamseg has not written
        is never replaced.
    id_name : str, default "SegmentID"
        What the ids are called, also in an earlier output.

    Raises
    ------
    InvalidParameter
        Unknown suffix, a pattern, or `out` is one of the inputs.
    OutputExists
        `out` is there, and `overwrite` is False or streamseg has not written it.
    FileError
        The folder is missing or cannot be written to, or `out` is no file that can be written.
    """
    out = Path(out)
    if out.suffix.lower() not in OUTPUT_SUFFIXES:
        raise InvalidParameter(f"output {out} ends in {out.suffix!r}, must end in {', '.join(OUTPUT_SUFFIXES)}")
    if out.name.lower().endswith(_COPC_SUFFIX):
        plain = out.name[: -len(_COPC_SUFFIX)] + out.suffix
        raise InvalidParameter(f"output {out} is called as COPC is, which is not written; name it {plain}")
    paths = [Path(path) for path in inputs]
    name = id_name or SEGMENT_DIMENSION
    check_file(out, paths, overwrite, "output", lambda old: _foreign(old, paths, overwrite, name))


def check_file(
    out: Path, inputs: Sequence[Path], overwrite: bool, what: str, foreign: Callable[[Path], str | None]
) -> None:
    """Refuse to write a file of any kind; see `check_output`.

    `what` names it in messages, and `foreign` says of one that is there what it is, if it must not be replaced.
    """
    target = _target(out)
    refuse_pattern(out, what)
    if not is_folder(target.parent):
        raise FileError(f"cannot write {out}: the folder {target.parent} does not exist")
    if there(target) is not None:
        _check_existing(out, inputs, what)
        _check_replaced(out, overwrite, foreign)
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise FileError(f"cannot write {out}: no permission to write into the folder {real(target.parent)}")


def refuse_pattern(out: Path, what: str) -> None:
    """Refuse a name that nothing can have, or that is a pattern for many, unless it is there."""
    if is_pattern(out):
        raise InvalidParameter(
            f"{what} is {out}, allowed: the name of one file or folder, without * or ?, or brackets that fit another"
        )


def _foreign(out: Path, inputs: Sequence[Path], overwrite: bool, id_name: str) -> str | None:
    found = foreign(out, inputs, id_name)
    if found is None and overwrite and is_like_inputs(out, inputs, id_name):
        found = "labelled as the inputs beside it are"
    if found is not None and any(path.suffix.lower() == out.suffix.lower() for path in inputs):
        return f"{found} (is OUT missing?)"
    return found


def _check_existing(out: Path, inputs: Sequence[Path], what: str) -> None:
    _require_file(out)
    for path in inputs:
        said = there(path)
        if said is not None and os.path.samestat(said, out.stat()):
            raise InvalidParameter(f"{what} {out} is the input {path}; give the {what} another name")


def _require_file(out: Path) -> None:
    """Refuse what is there and no file: a device would be replaced as a file is."""
    if out.is_dir():
        raise FileError(f"cannot write {out}: it is a folder")
    if out.exists() and not out.is_file():
        raise FileError(f"cannot write {out}: it is a pipe or a device, and only files are written")


def _check_replaced(out: Path, overwrite: bool, foreign: Callable[[Path], str | None]) -> None:
    try:
        found = foreign(out)
    except OSError as error:
        raise FileError(f"cannot write {out}: what is there cannot be read ({error.strerror})") from error
    if found is not None:
        raise OutputExists(f"{out} exists already and is {found}; give another name, or remove that file first")
    if not overwrite:
        raise OutputExists(f"{out} exists already; give another name, or overwrite=True (--overwrite)")
    if not out.stat().st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH) or not os.access(out, os.W_OK):
        raise FileError(f"cannot write {out}: it is read-only; give another name, or make it writable")


def _target(out: Path) -> Path:
    """Follow symbolic links to the file that is to be written; the links stay."""
    said = there(out, is_followed=False)
    if said is None or not stat.S_ISLNK(said.st_mode):
        return out
    target = real(out)
    said = there(target, is_followed=False)
    if said is not None and stat.S_ISLNK(said.st_mode):
        raise FileError(f"cannot write {out}: it is a symbolic link that leads to itself")
    return target


@contextmanager
def replacing(out: Path, *, overwrite: bool = True) -> Iterator[BinaryIO]:
    """Open a temporary file beside `out` that takes its name at the end, or is removed when anything fails.

    A symbolic link stays, and the file that it leads to is replaced. The new file has the mode of the old.

    Parameters
    ----------
    out : Path
    overwrite : bool
        Whether a file that has come to that name since the checks may be replaced.

    Raises
    ------
    FileError
        The file cannot be written, e.g. because the disk is full; or what is there is no file, but a folder, a
        pipe or a device.
    """
    claim: Claim | None = None
    guard: _ErrorKeeper | None = None
    home = Home(f"the writing of {out}")
    try:
        target = _target(out)
        _require_file(target)
        claim = claim_part(target.parent)
        with suppress(OSError):
            os.chmod(claim.path, stat.S_IMODE(target.stat().st_mode) & 0o777)
        with open(claim.path, "r+b") as file:
            guard = _ErrorKeeper(file)
            try:
                yield cast("BinaryIO", guard)
            finally:
                if not home.is_here:
                    abandon(file)
        home.check()
        _require_file(target)  # again: something may have come to that name meanwhile
        _take_name(claim, target, overwrite)
    except BaseException as error:
        if not home.is_here:
            raise
        # Encoders in Rust report a failed write without its cause; the file remembers it.
        cause = guard.error if guard is not None and guard.error is not None else error
        if isinstance(cause, OSError) and not isinstance(cause, FileError) and isinstance(error, Exception):
            raise FileError(
                f"cannot write {out}: {cause.strerror or cause}; nothing half-written is left in {real(out.parent)}"
            ) from error
        raise
    finally:
        if claim is not None:
            claim.release()


def _take_name(claim: Claim, target: Path, overwrite: bool) -> None:
    if overwrite:
        claim.path.replace(target)
        return
    try:
        os.link(claim.path, target)
    except FileExistsError:
        raise OutputExists(f"{target} exists already, since this run began; nothing is written") from None
    except OSError:  # no hard links in this folder
        claim.path.replace(target)


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
