"""LAZ is decoded in processes of its own: they crash alone and end in time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import laspy
import numpy as np
import pytest

from reference import laz_files
from streamseg.io import laz_decoder, laz_processes, open_cloud
from streamseg.io.laz_decoder import CHUNK, Request
from streamseg.io.laz_processes import Decoders, Undecodable

if TYPE_CHECKING:
    from reference.laz_files import LazFile


@pytest.fixture(scope="module")
def clip(data: Path, tmp_path_factory: pytest.TempPathFactory) -> LazFile:
    path = tmp_path_factory.mktemp("clip") / "clip.laz"
    return laz_files.write(path, laz_files.clip(data / "als" / "topography.laz", 12_000), 4_000)


def requests(clip: LazFile) -> list[Request]:
    with laspy.open(clip.path) as reader:
        record = bytes(reader.header.vlrs.get("LasZipVlr")[0].record_data)
    edges = zip(clip.starts, clip.starts[1:], clip.counts, strict=False)
    path, size = os.fsencode(clip.path), clip.records.itemsize
    return [Request(CHUNK, path, record, start, end - start, count, size) for start, end, count in edges]


def points_of(path: Path) -> np.ndarray:
    return np.concatenate([chunk.points for chunk in open_cloud(path).chunks()])


def test_answers_come_in_the_order_of_the_requests(clip: LazFile) -> None:
    with Decoders() as decoders:
        answers = [decoders.whole(request) for request in requests(clip)]
    assert b"".join(answers) == clip.records.tobytes()


def test_a_process_that_is_ended_from_outside_is_replaced(clip: LazFile) -> None:
    request = requests(clip)[1]
    with Decoders() as decoders:
        decoders.ask(request)
        decoders._asked[0][1]._process.kill()  # type: ignore[union-attr]
        assert b"".join(decoders.pieces()) == clip.records[4_000:8_000].tobytes()


def test_a_decoder_that_crashes_is_damage_and_the_next_request_is_answered(
    clip: LazFile, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script = tmp_path / "crashes.py"
    crash = "        if request.points == 13:\n            import os\n            os.abort()\n"
    source = Path(laz_decoder.__file__).read_text()
    script.write_text(source.replace('        said = b""\n', crash + '        said = b""\n'))
    monkeypatch.setattr(laz_processes, "_SCRIPT", script)
    sound = requests(clip)[0]
    with Decoders() as decoders:
        with pytest.raises(Undecodable, match="the decoder crashed on it"):
            decoders.whole(sound._replace(points=13))
        assert decoders.whole(sound) == clip.records[:4_000].tobytes()


def test_where_no_process_can_be_started_it_is_decoded_in_this_one(
    clip: LazFile, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fake = tmp_path / "python"
    fake.write_text("#!/bin/sh\nexit 0\n")
    fake.chmod(0o755)
    for executable in ("", "/usr/bin/qgis", str(fake), str(tmp_path / "python-that-is-not-there")):
        monkeypatch.setattr(sys, "executable", executable)
        assert np.array_equal(points_of(clip.path), clip.steps), executable


def test_processes_end_with_the_reading(clip: LazFile, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: object, **named: object) -> None:
            super().__init__(*arguments, **named)  # type: ignore[call-overload]
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    chunks = open_cloud(clip.path).chunks(1_000)
    next(chunks)
    assert started
    assert all(process.poll() is None for process in started)
    chunks.close()  # type: ignore[attr-defined]
    assert all(process.poll() is not None for process in started)
    list(open_cloud(clip.path).chunks())
    assert all(process.poll() is not None for process in started)


FORKS = """
import os, sys
import numpy as np
import streamseg as ss
from streamseg import scenes
from streamseg.io import open_cloud
from streamseg.io.laz_threads import can_compress_in_threads
path, folder = sys.argv[1:]
scenes.write(f"{folder}/parent.laz", "street", 60_000)  # starts the threads of the compressor
assert can_compress_in_threads()
chunks = open_cloud(path).chunks(1_000)
read = len(next(chunks).points)
child = os.fork()
read += sum(len(chunk.points) for chunk in chunks)
if child == 0:
    scenes.write(f"{folder}/child.laz", "street", 60_000)
    written = ss.segment_file(path, f"{folder}/out.laz", ss.Proximity(2.0), threads=1).points
    os._exit(0 if read == written == 12_000 and not can_compress_in_threads() else 1)
assert read == 12_000
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_child_reads_on_and_writes(clip: LazFile, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", FORKS, str(clip.path), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "child.laz").read_bytes()[300:] == (tmp_path / "parent.laz").read_bytes()[300:]


@pytest.mark.parametrize("point_format", [1, 6])
def test_large_records_and_large_chunks_come_in_small_pieces(tmp_path: Path, point_format: int) -> None:
    header = laspy.LasHeader(version="1.4", point_format=point_format)
    header.add_extra_dims([laspy.ExtraBytesParams(f"e{index}", "3f8") for index in range(100)])
    points = laspy.ScaleAwarePointRecord.zeros(8_000, header=header)
    points.X[:] = np.arange(8_000)
    points["e7"][:, 1] = np.arange(8_000)
    las = laspy.LasData(header, points)
    wide = laz_files.write(tmp_path / "wide.laz", las, 8_000)
    assert wide.records.nbytes > laz_decoder._HELD  # more than a process holds until it is proven
    for _ in range(2):
        source = open_cloud(wide.path).sources[0]
        blocks = [block.array.copy() for block in source.records(10**6)]  # type: ignore[attr-defined]
        assert len(blocks) > 1
        assert max(block.nbytes for block in blocks) <= 1 << 24
        assert np.concatenate(blocks).tobytes() == wide.records.tobytes()
    las.write(str(tmp_path / "wide.las"))
    plain = open_cloud(tmp_path / "wide.las").sources[0]
    blocks = [block.array.copy() for block in plain.records(10**6)]  # type: ignore[attr-defined]
    assert max(block.nbytes for block in blocks) <= 1 << 24
    assert np.concatenate(blocks).tobytes() == wide.records.tobytes()


def test_nothing_of_a_large_chunk_is_handed_out_before_it_is_proven(tmp_path: Path) -> None:
    header = laspy.LasHeader(version="1.2", point_format=0)
    points = laspy.ScaleAwarePointRecord.zeros(900_000, header=header)
    random = np.random.default_rng(1)
    points.X[:], points.Y[:] = random.integers(0, 10**6, (2, 900_000))
    large = laz_files.write(tmp_path / "large.laz", laspy.LasData(header, points), 900_000)
    assert large.records.nbytes > laz_decoder._HELD
    assert np.array_equal(points_of(large.path), large.steps)
    raw = bytearray(large.path.read_bytes())
    raw[large.starts[1] - 500 : large.starts[1] - 400] = bytes(100)
    (tmp_path / "hit.laz").write_bytes(raw)
    pieces = Decoders()
    with pieces as decoders:
        start, end = large.starts
        request = requests(large)[0]._replace(path=os.fsencode(tmp_path / "hit.laz"), start=start, length=end - start)
        decoders.ask(request)
        with pytest.raises(Undecodable):
            next(decoders.pieces())


def test_no_memory_for_the_proof_is_not_taken_for_another_encoder(
    clip: LazFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_memory(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("lazrs.LasZipCompressor", no_memory)
    with pytest.raises(MemoryError):
        laz_decoder._compressed(requests(clip)[0], [])


def test_a_decoder_that_would_go_on_for_ever_is_ended(
    clip: LazFile, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script = tmp_path / "hangs.py"
    source = Path(laz_decoder.__file__).read_text().replace("_SLOWEST = 600.0, 1e5", "_SLOWEST = 0.05, 1e9")
    hang = "        while request.points == 13:\n            pass\n"
    start = "        _allow(_seconds(request))\n"
    assert start in source
    script.write_text(source.replace(start, start + hang))
    monkeypatch.setattr(laz_processes, "_SCRIPT", script)
    with Decoders() as decoders, pytest.raises(Undecodable, match="the decoder crashed on it"):
        decoders.whole(requests(clip)[0]._replace(points=13))
