"""Files that a process holds, so that others can tell that it lives, and remove what a dead one has left.

A lock of the system goes with its process, however that ends. It belongs to the open file: a forked child
shares it, and takes nothing away by closing its copy. Where there are no such locks, as in some network
folders, nobody is refused and nothing is removed.
"""

from __future__ import annotations

import errno
import os
import platform
import re
import shutil
import sys
import tempfile
import weakref
import zlib
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from uuid import uuid4

from .home import Home

if TYPE_CHECKING:
    from collections.abc import Callable

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_HELD_BY_OTHERS = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)

# What other machines have left in a shared folder is theirs to remove: locks may not reach from one to another.
_HERE = f"{zlib.crc32(platform.node().encode('utf-8', 'replace')):08x}"
_PART = re.compile(rf"\.streamseg-{_HERE}-[0-9a-f]{{32}}\.part")
_SCRATCH = f"streamseg-labels-{_HERE}-"
_LOCK = "lock"


class HeldByOther(Exception):
    """Another process, or another run of this one, holds the file."""


class Claim:
    """A file that is held until it is released or thrown away, or its process ends."""

    def __init__(self, path: Path, file: int | None) -> None:
        self.path = path
        self._file = file
        self._home = Home(f"the claim to {path}")
        self._let_go = weakref.finalize(self, _let_go, file, self._home, path)

    @property
    def is_ours(self) -> bool:
        """Whether this process has made the claim, and not the one that it was forked from."""
        return self._home.is_here

    def release(self) -> None:
        """Let go and remove the file, if it still has its name. Again, or in a forked child: nothing."""
        if self.is_ours:
            self._let_go()

    def write(self, text: str) -> None:
        """Replace what the file says."""
        if self._file is not None:
            os.ftruncate(self._file, 0)
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, text.encode("ascii"))


def claim(path: Path, how: Literal["x", "a"] = "a") -> Claim:
    """Create or open a file and hold it; with "x" it must be new.

    Raises
    ------
    HeldByOther
        Somebody else holds it.
    OSError
        It cannot be opened.
    """
    flags = os.O_RDWR | os.O_CREAT | (os.O_EXCL if how == "x" else 0)
    while True:
        file = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0), 0o666)
        if _lock(file) is False:
            os.close(file)
            raise HeldByOther
        if _is_at(path, file):
            return Claim(path, file)
        # Between opening and locking, who held it before has removed it.
        os.close(file)


def claim_part(folder: Path) -> Claim:
    """Make a file with a name of its own, for an output to be; removes those that dead runs have left."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                left = Path(entry.path)
                _remove_if_left(left, left.unlink)
    while True:
        path = folder / f".streamseg-{_HERE}-{uuid4().hex}.part"
        if sys.platform == "win32":
            # There, no file that is open can take another name.
            path.touch(exist_ok=False)
            return Claim(path, None)
        with suppress(HeldByOther):
            return claim(path, "x")


class ScratchFolder:
    """A folder for temporary files that goes with this object; making one removes those that dead runs have left.

    Parameters
    ----------
    parent : Path or str, optional
        Where; the system's temporary folder if not given.
    """

    def __init__(self, parent: Path | str | None = None) -> None:
        within = Path(tempfile.gettempdir() if parent is None else parent)
        with suppress(OSError), os.scandir(within) as entries:
            for entry in entries:
                if entry.name.startswith(_SCRATCH) and entry.is_dir(follow_symlinks=False):
                    left = Path(entry.path)
                    _remove_if_left(left / _LOCK, partial(shutil.rmtree, left, ignore_errors=True))
        self.path, self._claim = self._make(within)
        self._remove = weakref.finalize(self, _remove_folder, self.path, Home(f"the folder {self.path}"))

    def remove(self) -> None:
        """Remove the folder and all that is in it; not in a forked child. Again, it does nothing."""
        if self._claim.is_ours:
            self._remove()
            self._claim.release()

    @staticmethod
    def _make(within: Path) -> tuple[Path, Claim]:
        while True:
            path = Path(tempfile.mkdtemp(prefix=_SCRATCH, dir=within))
            with suppress(HeldByOther, FileNotFoundError):
                return path, claim(path / _LOCK, "x")


def _remove_if_left(path: Path, remove: Callable[[], object]) -> None:
    """Remove something if the process that held its file is dead."""
    with suppress(OSError):
        file = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
        try:
            if _lock(file) and _is_at(path, file):
                remove()
        finally:
            os.close(file)


def _lock(file: int) -> bool | None:
    """Lock an open file; False if somebody else has locked it, None if there are no locks here."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in _HELD_BY_OTHERS else None
    return True


def _is_at(path: Path, file: int) -> bool:
    """Whether an open file still has its name."""
    try:
        return os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(file))
    except FileNotFoundError:
        return False


def _let_go(file: int | None, home: Home, path: Path) -> None:
    """Remove the name and close the file; in a forked child, close its copy only."""
    if home.is_here:
        with suppress(OSError):
            if file is None or _is_at(path, file):
                path.unlink()
        if sys.platform != "win32" and file is not None:
            # A forked child may have a copy, which would keep the lock.
            with suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_UN)
    if file is not None:
        os.close(file)


def _remove_folder(path: Path, home: Home) -> None:
    if home.is_here:
        shutil.rmtree(path, ignore_errors=True)
