"""What a command says. Nobody has to hear it: what was to be done is done all the same.

A stream that cannot be written to goes silent. When the command has ended, a full standard output is told
and a closed pipe is an exit status of its own, as with other tools.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
from collections.abc import Iterator
from io import TextIOWrapper
from typing import Any, TextIO

from .arguments import WRONG

_CLOSED_PIPE = 128 + int(getattr(signal, "SIGPIPE", 13))


@contextlib.contextmanager
def heard() -> Iterator[None]:
    """Let the streams go silent, and the exit status tell it if all else went well."""
    _open_closed()
    out, told = _Voice(sys.stdout), _Voice(sys.stderr)
    sys.stdout, sys.stderr = out, told
    try:
        yield
    except SystemExit as end:
        out.flush()
        if out.failure is None or end.code not in (None, 0):
            raise
        if out.failure.errno == errno.EPIPE:
            raise SystemExit(_CLOSED_PIPE) from None
        told.write(f"streamseg: cannot write to standard output: {out.failure.strerror}; all else has been done\n")
        told.flush()
        raise SystemExit(WRONG) from None


class _Voice:
    """A text stream that goes silent at its first failure."""

    def __init__(self, stream: TextIO | None) -> None:
        # Where a process has none, there is nobody to hear.
        self._stream: Any = open(os.devnull, "w", encoding="utf-8") if stream is None else stream  # noqa: SIM115
        self.failure: OSError | None = None
        if isinstance(self._stream, TextIOWrapper) and self._stream.errors == "strict":
            # Names of files may have letters that a terminal has not.
            self._stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        """Write, if that can be done."""
        self._try(self._stream.write, text)
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write, if that can be done."""
        self._try(self._stream.writelines, lines)

    def flush(self) -> None:
        """Write what waits, if that can be done."""
        self._try(self._stream.flush)

    def _try(self, call: Any, *arguments: Any) -> None:
        if self.failure is None:
            try:
                call(*arguments)
            except OSError as failure:
                self.failure = failure
                self._silence()

    def _silence(self) -> None:
        """Send what still waits nowhere: the interpreter tries again when it ends."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        with contextlib.suppress(OSError):
            os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":
            # With it, typer would go round this on terminals that have ASCII only.
            raise AttributeError(name)
        return getattr(self._stream, name)


def _open_closed() -> None:
    """Open what is closed of the three streams: else files that are written would take their numbers."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
