"""What is at a path that somebody gave: a file that can be read again and again, something else, or nothing.

Every look at such a path goes through here: what the system refuses, a name that is too long for example, is told
in one sentence.
"""

from __future__ import annotations

import glob
import os
import stat
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ..errors import FileError

if TYPE_CHECKING:
    from collections.abc import Iterator

_SPECIAL = {
    stat.S_IFIFO: "a pipe (FIFO)",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def there(path: Path, *, is_followed: bool = True) -> os.stat_result | None:
    """Look what is at a path, or at the end of the links there; None if there is nothing.

    Raises
    ------
    FileError
        It cannot be told, or nothing can ever be there.
    """
    try:
        return os.stat(path, follow_symlinks=is_followed)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise FileError(f"{path} cannot be reached: {error.strerror or error}") from None
    except ValueError:
        raise _no_path(path) from None


def is_folder(path: Path) -> bool:
    """Whether there is a folder at a path; see `there`."""
    said = there(path)
    return said is not None and stat.S_ISDIR(said.st_mode)


def real(path: Path | str) -> Path:
    """Follow all links of a path, as far as they lead anywhere.

    Raises
    ------
    FileError
        Nothing can ever be there.
    """
    try:
        return Path(os.path.realpath(path))
    except ValueError:
        raise _no_path(path) from None


def _no_path(path: Path | str) -> FileError:
    said = "a NUL character" if "\0" in str(path) else "a character that no name can have"
    return FileError(f"{str(path)!r} is no path of a file: it holds {said}")


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
        raise _no_path(path) from None
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
    """Whether a path that is not there is a pattern for many: brackets are so only where something fits them.

    Raises
    ------
    FileError
        See `there`.
    """
    if there(path) is not None:
        return False
    is_within = there(path.parent) is not None
    text = path.name if is_within else str(path)
    pattern = f"{glob.escape(str(path.parent))}/{path.name}" if is_within else str(path)
    return any(mark in text for mark in "*?") or ("[" in text and any(True for _ in glob.iglob(pattern)))


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
