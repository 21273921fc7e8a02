"""The exceptions and the warning that streamseg raises, all below one root.

Each child also derives from the builtin that Python people expect, so that ``except ValueError`` and
``except OSError`` keep working.
"""


class StreamsegError(Exception):
    """Root of every error raised by streamseg."""


class InvalidInput(StreamsegError, ValueError):
    """The points, or what a file holds, cannot be used as given."""


class InvalidParameter(StreamsegError, ValueError):
    """A parameter has a value outside what is allowed."""


class SegmentorError(StreamsegError, ValueError):
    """A segmentor returned something that is not one label per point."""


class FileError(StreamsegError, OSError):
    """A file cannot be read or written."""


class OutputExists(FileError, FileExistsError):
    """The output is already there and overwriting it was not asked for."""


class MissingExtra(StreamsegError, ImportError):
    """An optional dependency is not installed."""


class StreamsegWarning(UserWarning):
    """Something works, though not quite as asked for."""
