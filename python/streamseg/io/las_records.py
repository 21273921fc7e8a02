"""Variable length records of LAS files, byte by byte as they stand there.

laspy writes their heads and some payloads in its own way, and cannot read names that are no UTF-8. What is kept is
therefore the bytes; what laspy gets to read is a copy that it can.
"""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from ..errors import FileError, warn
from .opening import reading

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

VLR, EVLR = struct.Struct("<2s16sHH32s"), struct.Struct("<2s16sHQ32s")
LONGEST_VLR = 65535

EXTRA_BYTES, WAVEFORMS = ("LASF_Spec", 4), ("LASF_Spec", 65535)
_DESCRIPTION_BYTES = 192
_BLOCK_BYTES = 1 << 20
_NAME_AT, _NAME_BYTES = 4, 32


class Stored:
    """A payload that stays in its file until it is read; it may be larger than the memory."""

    def __init__(self, path: Path, at: int, length: int) -> None:
        self._path, self._at, self._length = path, at, length

    def __len__(self) -> int:
        return self._length

    def __bytes__(self) -> bytes:
        return b"".join(self.blocks())

    def blocks(self) -> Iterator[bytes]:
        """Read it block by block."""
        with reading(self._path) as file:
            file.seek(self._at)
            for start in range(0, self._length, _BLOCK_BYTES):
                block = file.read(min(_BLOCK_BYTES, self._length - start))
                yield block
                if len(block) < min(_BLOCK_BYTES, self._length - start):
                    raise FileError(f"{self._path} became shorter while it was read")


class Record(NamedTuple):
    """A record: its head with the length left out, and its payload."""

    reserved: bytes
    user: bytes
    record_id: int
    about: bytes
    data: bytes | Stored

    @property
    def key(self) -> tuple[str, int]:
        """Who has defined the record, and its number there."""
        return self.user.split(b"\0")[0].decode("latin-1"), self.record_id

    def packed_head(self, layout: struct.Struct) -> bytes:
        """Pack all that stands before the payload."""
        return layout.pack(self.reserved, self.user, self.record_id, len(self.data), self.about)


def new_record(key: tuple[str, int], about: str, data: bytes) -> Record:
    """Make a record."""
    return Record(bytes(2), key[0].encode("latin-1"), key[1], about.encode("latin-1"), data)


def whole_records(data: bytes, at: int, announced: int, layout: struct.Struct) -> list[Record]:
    """List the records that lie completely inside `data`; laspy goes on reading behind the end."""
    found: list[Record] = []
    while len(found) < announced and at + layout.size <= len(data):
        reserved, user, number, length, about = layout.unpack_from(data, at)
        at += layout.size + length
        if at > len(data):
            break
        found.append(Record(reserved, user, number, about, data[at - length : at]))
    return found


def stored_records(file: BinaryIO, path: Path, at: int, announced: int) -> list[Record]:
    """List the extended records that lie completely inside a file; their payloads stay there."""
    end, found = os.fstat(file.fileno()).st_size, list[Record]()
    while len(found) < announced and at + EVLR.size <= end:
        file.seek(at)
        reserved, user, number, length, about = EVLR.unpack(file.read(EVLR.size).ljust(EVLR.size, b"\0"))
        at += EVLR.size + length
        if at > end:
            break
        found.append(Record(reserved, user, number, about, Stored(path, at - length, length)))
    return found


def descriptions(record: Record) -> list[bytes]:
    """Split the record of extra dimensions into what it says of each."""
    data, step = bytes(record.data), _DESCRIPTION_BYTES
    return [data[at : at + step] for at in range(0, len(data) - step + 1, step)]


def legible(raw: bytes, vlrs_at: int, vlrs: list[Record], taken: Collection[str], path: Path) -> bytes:
    """Copy what stands before the points so that laspy can read it.

    Identifiers of records get ASCII letters only. Names of extra dimensions become UTF-8, and differ from each other
    and from the names of the standard dimensions, which are `taken`.
    """
    copy, at, is_first = bytearray(raw), vlrs_at, True
    for record in vlrs:
        copy[at + 2 : at + 18] = bytes(byte if byte < 0x80 else ord("?") for byte in record.user)
        at += VLR.size
        if record.key == EXTRA_BYTES and is_first:
            is_first = False
            names = _distinct([_name(one) for one in descriptions(record)], taken, path)
            for number, name in enumerate(names):
                start = at + number * _DESCRIPTION_BYTES + _NAME_AT
                copy[start : start + _NAME_BYTES] = name.encode().ljust(_NAME_BYTES, b"\0")
        at += len(record.data)
    return bytes(copy)


def _name(description: bytes) -> str:
    raw = description[_NAME_AT : _NAME_AT + _NAME_BYTES].split(b"\0")[0]
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return _shortened(raw.decode("latin-1"))


def _distinct(names: list[str], taken: Collection[str], path: Path) -> list[str]:
    """Give names that are there already another one, and say so."""
    distinct: list[str] = []
    for name in names:
        chosen, number = name, 1
        while chosen in taken or chosen in distinct:
            chosen = _shortened(f"extra_{name}" if number == 1 else f"extra_{number}_{name}")
            number += 1
        if chosen != name:
            warn(
                f"{path.name} has two dimensions called {name!r}; the later one, an extra dimension, is {chosen!r} here"
            )
        distinct.append(chosen)
    return distinct


def _shortened(name: str) -> str:
    return name.encode()[:_NAME_BYTES].decode(errors="ignore")
