"""Which process something belongs to: a forked one has a copy of it, and shares places in its files."""

from __future__ import annotations

import os
from typing import BinaryIO

from ..errors import StreamInUse


class Home:
    """The process that something was made in."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._process = os.getpid()

    @property
    def is_here(self) -> bool:
        """Whether this is still that process."""
        return os.getpid() == self._process

    def check(self) -> None:
        """Refuse to go on in another process.

        Raises
        ------
        StreamInUse
            This process was forked from that one.
        """
        if not self.is_here:
            raise StreamInUse(
                f"{self._what} belongs to process {self._process}; a forked process cannot go on with it, so open it "
                "anew there"
            )


def abandon(file: BinaryIO) -> None:
    """Let what waits in the buffer of a file go nowhere: the other process will write it."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, file.fileno())
    os.close(nowhere)
