"""Sources and sinks: the files people have, read and written as streams in bounded memory.

`open_cloud` reads LAS, LAZ, NumPy and text files as one stream of chunks; `write_labelled` writes them again with a
segment id per point; `LabelSpool` keeps the ids in between; `read_labels` reads a labelled file.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import FileError, InvalidInput
from . import npy, text
from .cloud import Chunk, Cloud, Source
from .labels import LabelSource, LabelSpool
from .lattice import Lattice
from .output import check_output, is_pattern
from .sink import check_kind, read_labels, write_labelled

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "Chunk",
    "Cloud",
    "LabelSource",
    "LabelSpool",
    "Lattice",
    "check_kind",
    "check_output",
    "open_cloud",
    "read_labels",
    "write_labelled",
]

_LAS_SUFFIXES = (".las", ".laz")


def open_cloud(paths: Path | str | Sequence[Path | str]) -> Cloud:
    """Open one or more files as a single stream of points.

    Parameters
    ----------
    paths : Path, str or sequence of them
        All LAS/LAZ, all ``.npy`` or all text (``.xyz .txt .csv .pts .asc``); the suffix decides. Several files are
        one stream in the order given.

    Raises
    ------
    FileError
        A file is missing, empty, or not what its suffix says.
    InvalidInput
        A suffix is unknown, the files are of different kinds, or there are no points.
    MissingExtra
        A LAS or LAZ file, and laspy is not installed.

    Examples
    --------
    >>> import numpy, tempfile
    >>> folder = tempfile.mkdtemp()
    >>> numpy.save(f"{folder}/points.npy", numpy.zeros((10, 3)))
    >>> cloud = open_cloud(f"{folder}/points.npy")
    >>> [chunk.points.shape for chunk in cloud.chunks(4)]
    [(4, 3), (4, 3), (2, 3)]
    """
    if isinstance(paths, (str, Path)):
        paths = [paths]
    return Cloud([_open_source(Path(path)) for path in paths])


def _open_source(path: Path) -> Source:
    suffix = path.suffix.lower()
    if suffix not in (*_LAS_SUFFIXES, ".npy", *text.SUFFIXES):
        raise InvalidInput(
            f"{path} ends in {suffix!r}, which is not known; known are .las, .laz, .npy, {', '.join(text.SUFFIXES)}"
        )
    try:
        if suffix in _LAS_SUFFIXES:
            from .las import LasSource

            return LasSource(path)
        return npy.NpySource(path) if suffix == ".npy" else text.TextSource(path)
    except FileNotFoundError:
        hint = "; the shell makes names of a pattern, if it is not quoted" if is_pattern(path) else ""
        raise FileError(f"{path} does not exist{hint}") from None
    except (IsADirectoryError, PermissionError) as error:
        raise FileError(f"{path} cannot be read: {error.strerror}") from error
