"""The header of a ``.npy`` file, checked before anything is built from it.

NumPy's own reader evaluates what it finds, and what a damaged header does to it can be any error.
"""

from __future__ import annotations

import ast
import os
import re
import warnings
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy_format

from ..errors import FileError, InvalidInput
from .limits import LONGEST_POINT, MOST_COLUMNS

if TYPE_CHECKING:
    from pathlib import Path

_MAGIC = b"\x93NUMPY"

# Bytes of the header's length, and its encoding, by version.
_VERSIONS = {(1, 0): (2, "latin-1"), (2, 0): (4, "latin-1"), (3, 0): (4, "utf-8")}
_LONGEST_HEADER = 1 << 16
_LONGEST_SHOWN = 80


class Header(NamedTuple):
    """What the array is.

    shape : (n,) of fields, or (n, columns)
    by_column : whether columns are stored one after the other
    dtype : of an item
    data_at : where the items start
    """

    shape: tuple[int, ...]
    by_column: bool
    dtype: np.dtype[Any]
    data_at: int

    @property
    def width(self) -> int:
        """Items per point."""
        return self.shape[1] if len(self.shape) == 2 else 1


def read_header(file: BinaryIO, path: Path) -> Header:
    """Read the header at the beginning of a file.

    Raises
    ------
    FileError
        It is no such header.
    InvalidInput
        It is, but of an array that holds no points, or too much for one point.
    """
    if os.fstat(file.fileno()).st_size == 0:
        raise FileError(f"{path} is empty, a .npy file was expected")
    described = _described(path, _text(file, path))
    shape, descr = described["shape"], described["descr"]
    if not (isinstance(shape, tuple) and all(type(count) is int and count >= 0 for count in shape)):
        raise _no_npy(path, f"its shape is {_shown(shape)}")
    dtype = _dtype(path, descr)
    header = Header(shape, described["fortran_order"] and len(shape) == 2, dtype, file.tell())
    _require_points(path, header)
    return header


def _text(file: BinaryIO, path: Path) -> str:
    start = file.read(8)
    version = tuple(start[6:])
    if not start.startswith(_MAGIC):
        raise _no_npy(path, "it does not begin with \\x93NUMPY")
    if version not in _VERSIONS:
        raise _no_npy(path, f"its version is {'.'.join(map(str, version))}, known are 1.0, 2.0 and 3.0")
    size, encoding = _VERSIONS[version]
    length = int.from_bytes(file.read(size), "little")
    if length > _LONGEST_HEADER:
        raise _no_npy(path, f"its header is {length:,} bytes long, allowed: {_LONGEST_HEADER:,}")
    header = file.read(length)
    if len(header) < length:
        raise _no_npy(path, "it ends within its header")
    try:
        return header.decode(encoding)
    except UnicodeDecodeError:
        raise _no_npy(path, "its header is not written in UTF-8") from None


def _described(path: Path, text: str) -> dict[str, Any]:
    # Python 2 wrote long numbers with an L behind.
    for version in (text, re.sub(r"(?<=\d)L(?=[,)])", "", text)):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # odd escapes
                described = ast.literal_eval(version.strip())
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
            continue
        if isinstance(described, dict) and set(described) == {"descr", "fortran_order", "shape"}:
            if isinstance(described["fortran_order"], bool):
                return described
            raise _no_npy(path, f"its fortran_order is {_shown(described['fortran_order'])}, allowed: True, False")
    raise _no_npy(path, f"its header is {_shown(text.strip())}")


def _dtype(path: Path, descr: Any) -> np.dtype[Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # spellings that go out of use
            dtype = npy_format.descr_to_dtype(descr)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError) as error:
        raise _no_npy(path, f"its items are {_shown(descr)} ({error})") from error
    except (SyntaxError, MemoryError, RecursionError) as error:
        raise _no_npy(path, f"its items are {_shown(descr)}") from error
    if dtype.hasobject:
        raise InvalidInput(f"{path} holds Python objects, which are never read; save numbers only")
    for name in dtype.names or ():
        if not name.isprintable() or any("\ud800" <= letter <= "\udfff" for letter in name):
            raise _no_npy(path, f"a field is called {name!r}")
    return dtype


def _require_points(path: Path, header: Header) -> None:
    """Refuse what is no array of points, before anything is made for each of its columns."""
    shape, dtype = header.shape, header.dtype
    columns = len(dtype.names) if dtype.names is not None else header.width
    if dtype.names is None:
        if dtype.kind not in "fiu":
            raise InvalidInput(f"{path} holds {_shown(dtype)}, expected numbers: float or integer")
        if len(shape) != 2 or columns < 3:
            raise InvalidInput(f"{path} has shape {_shown(shape)}, expected (n, 3) or wider")
    elif len(shape) != 1:
        raise InvalidInput(f"{path} holds fields and has shape {_shown(shape)}, expected (n,)")
    if columns > MOST_COLUMNS:
        raise InvalidInput(f"{path} has {columns:,} columns, allowed: {MOST_COLUMNS:,}")
    if dtype.itemsize * header.width > LONGEST_POINT:
        size = dtype.itemsize * header.width
        raise InvalidInput(f"{path} has {size:,} bytes per point, allowed: {LONGEST_POINT:,}")


def _no_npy(path: Path, reason: str) -> FileError:
    return FileError(f"{path} is no .npy file that can be read: {reason}")


def _shown(value: object) -> str:
    text = str(value) if isinstance(value, (str, tuple, np.dtype)) else repr(value)
    return ascii(text)[1:-1] if len(text) <= _LONGEST_SHOWN else f"{ascii(text[:_LONGEST_SHOWN])[1:-1]}…"
