"""The exceptions and the warning that streamseg raises, all below one root.

Each child also derives from the builtin that Python people expect, so that ``except ValueError`` and
``except OSError`` keep working.
"""

import sys
import warnings


class StreamsegError(Exception):
    """Root of every error raised by streamseg."""


class InvalidInput(StreamsegError, ValueError):
    """The points, or what a file holds, cannot be used as given."""


class InvalidParameter(StreamsegError, ValueError):
    """A parameter has a value outside what is allowed."""


class InvalidType(InvalidParameter, TypeError):
    """A parameter is something else than what is allowed."""


class SegmentorError(StreamsegError, ValueError):
    """A segmentor returned something that is not one label per point, or raised StopIteration."""


class FileError(StreamsegError, OSError):
    """A file cannot be read or written."""


class StreamInUse(StreamsegError, RuntimeError):
    """A stream was asked for a span while it was at work on one, or in a forked process."""


class OutputExists(FileError, FileExistsError):
    """The output is already there and overwriting it was not asked for."""


class MissingExtra(StreamsegError, ImportError):
    """An optional dependency is not installed."""


class StreamsegWarning(UserWarning):
    """Something works, though not quite as asked for."""


def warn(message: str) -> None:
    """Warn of something at the place outside of streamseg that led to it."""
    level = 2
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == "streamseg":
        frame = frame.f_back
        level += 1
    warnings.warn(message, StreamsegWarning, stacklevel=level)
