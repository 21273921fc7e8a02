"""Decodes LAZ and proves it, one chunk at a time: a script that runs in a process of its own.

lazrs believes what it reads: damaged data can crash it, or pass for other points. A process of its
own takes no run with it, and shows no panic text. What proves a chunk is that its points give the same
bytes when they are compressed again. Encoders of other kinds may choose others: then it counts that the
decoder needs all bytes of the chunk and none beyond, for damage changes how many it needs.

It starts within some 20 ms, because it imports no more than lazrs. Requests come in through stdin.
Answers go out through stdout: pieces, each with its length in front; a 0; and what went wrong.
"""

from __future__ import annotations

import signal
import struct
import sys
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

if __name__ == "__main__":
    sys.path.append(sys.argv[1])  # where lazrs is

import lazrs

LIBRARY: str = lazrs.__file__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import Any

    Decode = Callable[[BinaryIO, "Request"], Iterator[bytearray]]

GREETING = b"LAZ?"
LENGTH = struct.Struct("<I")
PAIR = struct.Struct("<QQ")

# Damage and a file that is cut off look alike to a decoder.
ENDS_EARLY = "the data end too early"

# What can be asked for.
CHUNK, REST, EXTENT, TABLE = range(4)

POINTWISE, CHUNKED, LAYERED = 1, 2, 3
ITEMS_AT = 32
_CHUNK_SIZE_AT = 12
_ITEM = struct.Struct("<HHH")
_EXTRA_BYTES = 14  # an item with one layer per byte

# Layers are named by one bit each; shifted by one they are what lazrs calls a selection.
EVERYTHING = 0x1FFF
_LAYERS = {10: [1 << bit for bit in range(9)], 11: [1 << 9], 12: [1 << 9, 1 << 10], 13: [1 << 11]}
_LAYER_OF_EXTRA_BYTES = 1 << 12

_PIECE = 1 << 20
_HELD = 1 << 24
_STEP = 4096
_MOST_SECONDS, _SLOWEST = 600.0, 1e5
_PADDING = bytes(64)
_PLACE_OF_TABLE = 8

# How an encoder ends depends on all that it has encoded; damage gives other last bytes than these.
_END = 16


class Request(NamedTuple):
    """What is to be decoded.

    kind : CHUNK = a whole chunk, proven; REST = what can be decoded of one that is cut off;
        EXTENT = how many bytes a chunk of unknown length takes; TABLE = the chunk table
    path : the file; start, length : where in it; TABLE starts where the points do
    record : the laszip record; size : bytes of a point; points : how many are there
    selection : layers to decode; proven : layers that need no proof any more
    skip : bytes of the answer that are there already
    """

    kind: int
    path: bytes
    record: bytes
    start: int
    length: int
    points: int
    size: int
    selection: int = EVERYTHING
    proven: int = 0
    skip: int = 0


_HEAD = struct.Struct("<BIIQQQIIIQ")


class Damage(Exception):
    """The data are not what they should be."""


def packed(request: Request) -> bytes:
    """Turn a request into bytes."""
    kind, path, record, *numbers = request
    return _HEAD.pack(kind, len(path), len(record), *numbers) + path + record


def _unpacked(file: BinaryIO) -> Request | None:
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    kind, path, record, *numbers = _HEAD.unpack(head)
    return Request(kind, file.read(path), file.read(record), *numbers)


def answer(request: Request) -> Iterator[bytes | bytearray]:
    """Answer a request in pieces of bounded size, the first only when everything is proven.

    Raises
    ------
    Damage
        It is damaged, in a few words. What lazrs raises means the same.
    """
    with open(request.path, "rb") as file:
        yield from _without(request.skip, _pieces(file, request))


def in_words(error: BaseException) -> str:
    """Say what went wrong in a decoder."""
    if isinstance(error, (Damage, MemoryError)):
        return str(error) or "there is not enough memory to decode it"
    if isinstance(error, OSError):
        return f"it cannot be read: {error.strerror or error}"
    return ENDS_EARLY if _is_end(error) else f"the decoder says: {error}"


def layers_of(record: bytes) -> list[int]:
    """Name the compressed layers of a chunk, in their order; none where points are not layered."""
    layers: list[int] = []
    for kind, size, _ in items_of(record):
        layers += [_LAYER_OF_EXTRA_BYTES] * size if kind == _EXTRA_BYTES else _LAYERS.get(kind, [])
    return layers


def items_of(record: bytes) -> list[tuple[int, int, int]]:
    """List what a point consists of: kind, bytes and version of each item."""
    (count,) = struct.unpack_from("<H", record, ITEMS_AT)
    there = min(count, (len(record) - ITEMS_AT - 2) // _ITEM.size)
    return list(_ITEM.iter_unpack(record[ITEMS_AT + 2 : ITEMS_AT + 2 + there * _ITEM.size]))


def _pieces(file: BinaryIO, request: Request) -> Iterator[bytes | bytearray]:
    if request.kind == TABLE:
        return _table(file, request)
    if request.kind == EXTENT:
        return _extent(file, request)
    if request.kind == REST:
        return _rest(file, request)
    decode = _layered if layers_of(request.record) else _pointwise
    if request.points * request.size <= _HELD:
        return iter(_proven(file, request, decode))
    if request.selection & ~request.proven:
        for _ in decode(file, request):
            pass
    return decode(file, request._replace(proven=EVERYTHING))


def _proven(file: BinaryIO, request: Request, decode: Decode) -> list[bytearray]:
    """Decode a chunk that can be held, and prove it."""
    if request.selection == EVERYTHING and request.proven != EVERYTHING:
        points = list(decode(file, request._replace(proven=EVERYTHING)))
        file.seek(request.start)
        if _is_same(file.read(request.length), _compressed(request, points), request):
            return points
    return list(decode(file, request))


def _compressed(request: Request, points: Iterable[bytearray]) -> bytes:
    """Compress a chunk again; nothing if there is no encoder of its kind."""
    target = BytesIO()
    try:
        encoder = lazrs.LasZipCompressor(target, lazrs.LazVlr(_record_of_one_chunk(request)))
        for block in points:
            encoder.compress_many(block)
        encoder.done()
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException:  # a Rust panic derives from BaseException only
        return b""
    return target.getvalue()[_PLACE_OF_TABLE:]


def _is_same(stored: bytes, again: bytes, request: Request) -> bool:
    """Tell whether a chunk was compressed to the bytes that are stored.

    The table of chunks follows those of `again`.

    Raises
    ------
    Damage
        The same encoder has written it, and would have ended it in another way.
    """
    if again[: len(stored)] == stored:
        return True
    pairs = zip(_streams(stored, request), _streams(again, request), strict=True)
    for ours, theirs in pairs:
        is_alike = len(ours) == len(theirs) > 4 * _END and ours[:-_END] == theirs[:-_END]
        if is_alike and ours != theirs:
            raise Damage("the data of a chunk do not end as they should")
    return False


def _streams(chunk: bytes, request: Request) -> list[bytes]:
    """Split a chunk into what is compressed in it: its layers, or all that follows the first point."""
    bits = layers_of(request.record)
    if not bits:
        return [chunk[request.size : request.length]]
    counts = struct.Struct(f"<{1 + len(bits)}I")
    if len(chunk) < request.size + counts.size:
        return [b""] * len(bits)
    _, *sizes = counts.unpack_from(chunk, request.size)
    at, streams = request.size + counts.size, []
    for size in sizes:
        streams.append(chunk[at : at + size])
        at += size
    return streams


def _without(skip: int, pieces: Iterable[bytes | bytearray]) -> Iterator[bytes | bytearray]:
    for piece in pieces:
        if skip < len(piece):
            yield piece[skip:]
        skip = max(0, skip - len(piece))


def _pointwise(file: BinaryIO, request: Request) -> Iterator[bytearray]:
    """Decode a chunk, and a point behind it that is found only where the chunk should end."""
    sentinel = bytes((7 + place) & 0xFF for place in range(request.size))
    decoder = _decoder(request, _Part(file, request.start, request.length), BytesIO(sentinel + _PADDING))
    yield from _blocks(decoder, request.points, request.size)
    last = bytearray(request.size)
    decoder.decompress_many(last)
    if last != sentinel:
        raise Damage("the data of a chunk do not end where they should")


def _layered(file: BinaryIO, request: Request) -> Iterator[bytearray]:
    """Decode a chunk, and prove its layers: one that lacks its last byte has to fail."""
    bits = layers_of(request.record)
    counts = struct.Struct(f"<{1 + len(bits)}I")
    file.seek(request.start)
    head = file.read(request.size + counts.size)
    if len(head) < request.size + counts.size:
        raise Damage(ENDS_EARLY)
    count, *sizes = counts.unpack_from(head, request.size)
    if count != request.points or len(head) + sum(sizes) != request.length:
        raise Damage("the sizes of a chunk contradict each other")

    def decoder(selection: int, lacking: int | None = None) -> Any:
        at, parts, given = request.start + len(head), [], []
        for index, (bit, size) in enumerate(zip(bits, sizes, strict=True)):
            is_wanted = bit & (selection | 1)
            given.append(size - (index == lacking) if is_wanted else 0)
            parts.append(_Part(file, at, given[-1]))
            at += size
        start = BytesIO(head[: request.size] + counts.pack(count, *given))
        return _decoder(request, start, *parts, selection=selection)

    def decodes(decoder: Any) -> bool:
        try:
            for _ in _blocks(decoder, count, request.size):
                pass
        except lazrs.LazrsError as error:
            if _is_end(error):
                return False
            raise
        return True

    yield from _blocks(decoder(request.selection), count, request.size)
    for index, bit in enumerate(bits):
        needs_proof = bit & (request.selection | 1) & ~request.proven
        if needs_proof and sizes[index] and decodes(decoder(bit, lacking=index)):
            raise Damage("a layer of a chunk does not end where it should")


def _extent(file: BinaryIO, request: Request) -> Iterator[bytes | bytearray]:
    """Find out how many bytes so many points take; `length` is where the file ends."""
    part = _Part(file, request.start, request.length, step=1)
    for _ in _blocks(_decoder(request, part), request.points, request.size):
        pass
    yield struct.pack("<Q", part.at - request.start)


def _rest(file: BinaryIO, request: Request) -> Iterator[bytes | bytearray]:
    """Decode points until the data end, in steps that get small where they do."""
    done = 0
    for step in (_STEP, 1):
        decoder = _decoder(request, _Part(file, request.start, request.length))
        for _ in _blocks(decoder, done, request.size):
            pass
        try:
            while done < request.points:
                block = bytearray(min(step, request.points - done) * request.size)
                decoder.decompress_many(block)
                yield block
                done += len(block) // request.size
        except lazrs.LazrsError as error:
            if not _is_end(error):
                raise


def _table(file: BinaryIO, request: Request) -> Iterator[bytes | bytearray]:
    file.seek(request.start)
    pairs = lazrs.read_chunk_table(file, lazrs.LazVlr(request.record))
    step = _PIECE // PAIR.size
    for start in range(0, len(pairs), step):
        yield b"".join(PAIR.pack(*pair) for pair in pairs[start : start + step])


def _decoder(request: Request, *parts: Any, selection: int = EVERYTHING) -> Any:
    """Make a decoder for one chunk that has just these points."""
    place_of_table = BytesIO(bytes(_PLACE_OF_TABLE))
    selected = lazrs.DecompressionSelection(selection >> 1)
    return lazrs.LasZipDecompressor(_ForwardOnly(place_of_table, *parts), _record_of_one_chunk(request), selected)


def _record_of_one_chunk(request: Request) -> bytes:
    record = bytearray(request.record)
    if struct.unpack_from("<H", record) == (POINTWISE,):  # one chunk, though it is not called so
        struct.pack_into("<H", record, 0, CHUNKED)
    struct.pack_into("<I", record, _CHUNK_SIZE_AT, request.points)
    return bytes(record)


def _blocks(decoder: Any, points: int, size: int) -> Iterator[bytearray]:
    step = max(1, _PIECE // size)
    for start in range(0, points, step):
        block = bytearray(min(step, points - start) * size)
        decoder.decompress_many(block)
        yield block


def _is_end(error: BaseException) -> bool:
    return "fill whole buffer" in str(error)


class _Part:
    """A part of a file, given out in small bits if it has to be known how much was needed."""

    def __init__(self, file: BinaryIO, start: int, length: int, step: int | None = None) -> None:
        self._file, self.at, self._end, self._step = file, start, start + length, step

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer)[: self._end - self.at][: self._step]
        self._file.seek(self.at)
        count: int = self._file.readinto(view) if len(view) else 0  # type: ignore[attr-defined]
        self.at += count
        return count


class _ForwardOnly:
    """Parts read one after the other; that it cannot seek makes lazrs do without a chunk table."""

    def __init__(self, *parts: Any) -> None:
        self._parts = list(parts)

    def readinto(self, buffer: Any) -> int:
        while self._parts:
            if count := self._parts[0].readinto(buffer):
                return int(count)
            del self._parts[0]
        return 0

    def read(self, size: int) -> bytes:
        buffer = bytearray(size)
        return bytes(buffer[: self.readinto(buffer)])

    def seek(self, *_: int) -> int:
        raise OSError("this stream only goes forward")


def _seconds(request: Request) -> float:
    """Grant time for a request, many times what it takes: each layer is decoded and then proven."""
    passes = 1 + len(layers_of(request.record))
    return _MOST_SECONDS + request.points * request.size * passes / _SLOWEST


def _allow(seconds: float) -> None:
    """Have the system end this process after so much work, should damage keep the decoder busy for ever."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_PROF, seconds)


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    answers.write(GREETING)
    answers.flush()
    while (request := _unpacked(requests)) is not None:
        said = b""
        _allow(_seconds(request))
        try:
            for piece in answer(request):
                answers.write(LENGTH.pack(len(piece)))
                answers.write(piece)
        except BrokenPipeError:
            return
        except BaseException as error:  # a Rust panic derives from BaseException only
            said = in_words(error).encode("utf-8", "replace")
        answers.write(LENGTH.pack(0) + LENGTH.pack(len(said)) + said)
        answers.flush()


if __name__ == "__main__":
    _serve(sys.stdin.buffer, sys.stdout.buffer)
