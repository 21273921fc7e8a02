"""Processes that decode LAZ for this one, and are replaced when they crash."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import laz_decoder
from .home import Home
from .laz_decoder import GREETING, LENGTH, Request

if TYPE_CHECKING:
    from collections.abc import Iterator

_SCRIPT = Path(laz_decoder.__file__)
_PACKAGES = Path(laz_decoder.LIBRARY).parent.parent
_MOST = 2
_PATIENCE = 2  # crashes on one request; others may have ended the first


class Undecodable(Exception):
    """It is damaged; a few words say how."""


class _Gone(Exception):
    """The process cannot be talked to, or is another's."""

    def __init__(self, has_started: bool) -> None:
        super().__init__()
        self.has_started = has_started


class Decoders:
    """Answers requests in the order in which they were asked, a few of them at the same time.

    To be closed. A child that was forked in the middle of it goes on with processes of its own.
    """

    def __init__(self) -> None:
        self._idle: list[_Process | _Here] = []
        self._asked: deque[tuple[Request, _Process | _Here]] = deque()
        self._most = min(_MOST, _count_cores())
        self._is_alone = _can_start()

    def __enter__(self) -> Decoders:
        return self

    def __exit__(self, *_: object) -> None:
        for process in [*self._idle, *(process for _, process in self._asked)]:
            process.close()

    @property
    def has_room(self) -> bool:
        """Whether one more request would be worked on at once."""
        return len(self._asked) < self._most

    def ask(self, request: Request) -> None:
        """Ask for something; the answer is one of `pieces`."""
        self._asked.append((request, self._sent(request)))

    def pieces(self) -> Iterator[bytes | bytearray]:
        """Yield the answer to the oldest request.

        Raises
        ------
        Undecodable
            It is damaged, perhaps so that the decoder crashed on it.
        """
        crashes = received = 0
        while True:
            request, process = self._asked[0]
            try:
                for piece in process.answer():
                    received += len(piece)
                    yield piece
            except _Gone as gone:
                process.close()
                crashes += process.is_mine and gone.has_started
                if crashes == _PATIENCE:
                    self._asked.popleft()
                    raise Undecodable("the decoder crashed on it") from None
                self._note(gone)
                again = request._replace(skip=received)
                self._asked[0] = again, self._sent(again)
            except Undecodable:
                self._idle.append(self._asked.popleft()[1])
                raise
            else:
                self._idle.append(self._asked.popleft()[1])
                return

    def whole(self, request: Request) -> bytes:
        """Ask, and wait for the whole answer."""
        self.ask(request)
        return b"".join(self.pieces())

    def _sent(self, request: Request) -> _Process | _Here:
        while True:
            process = self._idle.pop() if self._idle else _started(self._is_alone)
            try:
                process.send(request)
            except _Gone as gone:
                process.close()
                self._note(gone)
            else:
                return process

    def _note(self, gone: _Gone) -> None:
        """Decode in this process from now on, if no other can be started."""
        self._is_alone = self._is_alone and gone.has_started


class _Process:
    """An interpreter that runs the decoder and nothing else; it ends when this process does."""

    def __init__(self) -> None:
        self._home = Home("the decoder")
        self._has_greeted = False
        # A session of its own: Ctrl-C is for the run, which ends this.
        self._process: Any = subprocess.Popen(
            [sys.executable, "-I", "-S", "-B", str(_SCRIPT), str(_PACKAGES)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    @property
    def is_mine(self) -> bool:
        return self._home.is_here

    def send(self, request: Request) -> None:
        if not self.is_mine:
            raise _Gone(has_started=True)
        try:
            self._process.stdin.write(laz_decoder.packed(request))
            self._process.stdin.flush()
        except OSError:
            raise _Gone(self._greeted()) from None

    def answer(self) -> Iterator[bytes | bytearray]:
        if not self.is_mine or not self._greeted():
            raise _Gone(has_started=self._has_greeted or not self.is_mine)
        while length := self._number():
            yield self._read(length)
            if not self.is_mine:
                raise _Gone(has_started=True)
        if length := self._number():
            raise Undecodable(self._read(length).decode("utf-8", "replace"))

    def close(self) -> None:
        if self.is_mine:
            self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):
                pipe.close()
        if self.is_mine:
            self._process.wait()
        else:
            self._process.returncode = 0  # its parent waits for it

    def _greeted(self) -> bool:
        if not self._has_greeted:
            self._has_greeted = self._process.stdout.read(len(GREETING)) == GREETING
        return self._has_greeted

    def _number(self) -> int:
        return int(LENGTH.unpack(self._read(LENGTH.size))[0])

    def _read(self, length: int) -> bytes:
        read: bytes = self._process.stdout.read(length)
        if len(read) < length:
            raise _Gone(has_started=True)
        return read


class _Here:
    """The decoder in this process, where no other can be started: a crash then ends the run."""

    is_mine = True

    def send(self, request: Request) -> None:
        self._request = request

    def answer(self) -> Iterator[bytes | bytearray]:
        try:
            yield from laz_decoder.answer(self._request)
        except (KeyboardInterrupt, SystemExit, GeneratorExit, MemoryError):
            raise
        except BaseException as error:  # a Rust panic derives from BaseException only
            raise Undecodable(laz_decoder.in_words(error)) from None

    def close(self) -> None:
        """Nothing is open."""


def _started(is_alone: bool) -> _Process | _Here:
    try:
        return _Process() if is_alone else _Here()
    except OSError:
        return _Here()


def _can_start() -> bool:
    """Whether the program that runs this is a Python interpreter, and not one that has it built in."""
    name = Path(sys.executable or "").name.lower()
    is_python = name.startswith(("python", "pypy")) and not getattr(sys, "frozen", False)
    return is_python and _SCRIPT.is_file()


def _count_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
