"""Files that can be read again and again: what else a path may lead to is refused in one sentence."""

from __future__ import annotations

import os
import re
import stat
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

from ..errors import FileError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# What a shell would have made names of: any * or ?, and brackets around a range.
_PATTERN = re.compile(r"[*?]|\[[^\]/]*\w-\w[^\]/]*\]")

_SPECIAL = {
    stat.S_IFIFO: "a pipe (FIFO)",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def require_file(path: Path) -> None:
    """Refuse what is no regular file, before anything waits for it.

    Raises
    ------
    FileError
        Nothing is there, it cannot be reached, or it is a folder, a pipe, a socket or a device.
    """
    try:
        mode = os.stat(path).st_mode
    except ValueError:
        raise FileError(f"{str(path)!r} is no path of a file: it holds a NUL character") from None
    except FileNotFoundError:
        if path.is_symlink():
            raise FileError(f"{path} does not exist: it links to {os.readlink(path)}") from None
        hint = "; the shell makes names of a pattern, if it is not quoted" if is_pattern(path) else ""
        raise FileError(f"{path} does not exist{hint}") from None
    except OSError as error:
        raise FileError(_unreadable(path, error)) from None
    if stat.S_ISDIR(mode):
        raise FileError(f"{path} cannot be read: it is a folder; give the files in it")
    if not stat.S_ISREG(mode):
        kind = _SPECIAL.get(stat.S_IFMT(mode), "something else")
        raise FileError(
            f"{path} is no regular file but {kind}, and points are read more than once; "
            "save them in a file and give that"
        )


def is_pattern(path: Path) -> bool:
    """Whether a path that is not there looks like a pattern for many."""
    within = _exists(path.parent)
    return not _exists(path) and _PATTERN.search(path.name if within else str(path)) is not None


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long
        return False


@contextmanager
def reading(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading; what the system refuses, now or later, is a `FileError`."""
    require_file(path)
    with telling(path), open(path, "rb") as file:
        yield file


@contextmanager
def telling(path: Path) -> Iterator[None]:
    """Turn what the system refuses into a `FileError` of one sentence."""
    try:
        yield
    except FileError:
        raise
    except OSError as error:
        raise FileError(_unreadable(path, error)) from error


def _unreadable(path: Path, error: OSError) -> str:
    return f"{path} cannot be read: {error.strerror or error}"
