"""The signals that ask a command to end: Ctrl-C, a closed terminal, and a system that shuts down."""

from __future__ import annotations

import signal
from types import FrameType

import typer

_ALIKE = ("SIGTERM", "SIGHUP")

_received = [int(signal.SIGINT)]


def listen() -> None:
    """Treat signals that ask to end like Ctrl-C; those that are ignored, as below nohup, stay ignored."""
    _received[1:] = []
    for name in _ALIKE:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _as_ctrl_c)


def behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """Find the interrupt that a command ended with: typer makes it an exit."""
    while isinstance(error, (SystemExit, typer.Exit)):
        error = error.__cause__ or error.__context__
    return error if isinstance(error, KeyboardInterrupt) else None


def status() -> int:
    """Exit status after an interrupt: 128 and the number of the signal, as shells have it."""
    return 128 + _received[-1]


def _as_ctrl_c(number: int, frame: FrameType | None) -> None:
    _received.append(number)
    on_ctrl_c = signal.getsignal(signal.SIGINT)
    if not callable(on_ctrl_c):
        raise KeyboardInterrupt
    on_ctrl_c(number, frame)
