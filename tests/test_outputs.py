"""Outputs replace what streamseg has written and nothing else; they keep modes and links; nothing is left lying."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from PIL import Image

import streamseg as ss
from streamseg.io import check_output
from streamseg.io.claims import claim_part
from streamseg.io.output import replacing
from streamseg.preview import check_preview

NEAR = ss.Proximity(1.0)
POINTS = np.column_stack([np.arange(12.0), np.zeros(12), np.zeros(12)])


def write_las(path: Path) -> Path:
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.x, las.y, las.z = POINTS.T
    las.write(path)
    return path


def write_text(path: Path) -> Path:
    np.savetxt(path, np.column_stack([POINTS, np.arange(12) % 3]), "%g")
    return path


def write_csv(path: Path) -> Path:
    np.savetxt(path, POINTS, "%g", ",", header="x,y,z", comments="")
    return path


def write_npy(path: Path) -> Path:
    np.save(path, POINTS)
    return path


WRITERS = {".las": write_las, ".laz": write_las, ".xyz": write_text, ".csv": write_csv, ".npy": write_npy}


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_last_of_the_inputs_taken_for_the_output_survives(tmp_path: Path, suffix: str) -> None:
    paths = [WRITERS[suffix](tmp_path / f"{name}{suffix}") for name in "abc"]
    before = paths[-1].read_bytes()
    for overwrite in (False, True):
        with pytest.raises(ss.OutputExists, match=r"streamseg has not written \(is OUT missing"):
            ss.segment_file(paths[:-1], paths[-1], NEAR, overwrite=overwrite)
        assert paths[-1].read_bytes() == before


@pytest.mark.parametrize("suffix", [".las", ".laz", ".csv"])
def test_so_does_the_last_of_several_labelled_inputs(tmp_path: Path, suffix: str) -> None:
    cloud = WRITERS[suffix](tmp_path / f"in{suffix}")
    (tmp_path / "tiles").mkdir()
    paths = [tmp_path / "tiles" / f"{name}{suffix}" for name in "abc"]
    for path in paths:
        ss.segment_file(cloud, path, NEAR)
    with pytest.raises(ss.OutputExists, match="labelled as the inputs beside it are"):
        ss.segment_file(paths[:-1], paths[-1], NEAR, overwrite=True)
    elsewhere = shutil.copy(paths[-1], tmp_path / f"out{suffix}")
    assert ss.segment_file(paths[:-1], elsewhere, NEAR, overwrite=True).points == 24


@pytest.mark.parametrize("before", WRITERS)
@pytest.mark.parametrize("after", [".las", ".laz", ".xyz", ".txt", ".csv", ".npy"])
def test_an_output_of_ours_is_replaced_again_and_again(tmp_path: Path, before: str, after: str) -> None:
    cloud, out = WRITERS[before](tmp_path / f"in{before}"), tmp_path / f"out{after}"
    for distance in (1.0, 0.5, 1.0):
        ss.segment_file(cloud, out, ss.Proximity(distance), overwrite=True)
        first = out.read_bytes()
    ss.segment_file(cloud, tmp_path / f"again{after}", NEAR)
    if after not in (".las", ".laz"):
        assert first == (tmp_path / f"again{after}").read_bytes()


FOREIGN: dict[str, Callable[[Path], object]] = {
    "cloud.las": write_las,
    "cloud.laz": write_las,
    "cloud.xyz": lambda path: np.savetxt(path, POINTS),
    "cloud.csv": write_csv,
    "cloud.npy": write_npy,
    "fields.npy": lambda path: np.save(path, np.zeros(5, [("x", "f8"), ("y", "f8"), ("z", "f8")])),
    "numbers.npy": lambda path: np.save(path, np.zeros(5)),
    "notes.txt": lambda path: path.write_text("years of work\n"),
    "table.csv": lambda path: path.write_text("name,height,width,count\noak,1.0,2.0,3\n"),
    "five.xyz": lambda path: path.write_text("1 2 3 4 5\n"),
    "real.xyz": lambda path: path.write_text("1 2 3 4.5\n"),
    "intensity.xyz": lambda path: path.write_text("1 2 3 40\n"),
    "beside.csv": lambda path: path.write_text("x,y,z,intensity\n0,0,0,40\n"),
    "classes.npy": lambda path: np.save(path, np.arange(5, dtype=np.int32)),
    "differences.npy": lambda path: np.save(path, np.arange(5) - 3),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_what_streamseg_has_not_written_is_never_replaced(tmp_path: Path, name: str) -> None:
    FOREIGN[name](tmp_path / name)
    before = (tmp_path / name).read_bytes()
    with pytest.raises(ss.OutputExists, match="exists already and is a"):
        ss.segment_file(write_las(tmp_path / "in.las"), tmp_path / name, NEAR, overwrite=True)
    assert (tmp_path / name).read_bytes() == before


@pytest.mark.parametrize("inputs", ["abx", "ab"])
def test_text_is_known_by_the_first_point_of_the_input(tmp_path: Path, inputs: str) -> None:
    for place, name in enumerate("abcx"):
        (tmp_path / f"{name}.xyz").write_text(f"{place} 0 0 7\n{place} 9 0 8\n")
    paths, out = [tmp_path / f"{name}.xyz" for name in inputs], tmp_path / "out.xyz"
    for _ in range(2):
        ss.segment_file(paths, out, NEAR, overwrite=True)
    out.write_text("1 0 0 7 1\n")
    with pytest.raises(ss.OutputExists, match="by its first line"):
        ss.segment_file(paths, out, NEAR, overwrite=True)


@pytest.mark.parametrize("before", WRITERS)
@pytest.mark.parametrize("after", [".las", ".csv", ".xyz"])
def test_outputs_whose_ids_have_another_name_are_known(tmp_path: Path, before: str, after: str) -> None:
    cloud, out = WRITERS[before](tmp_path / f"in{before}"), tmp_path / f"out{after}"
    for _ in range(2):
        ss.segment_file(cloud, out, NEAR, overwrite=True, id_name="tree")
    np.savetxt(other := tmp_path / "other.csv", POINTS + 1, "%d", ",", header="x,y,tree", comments="")
    with pytest.raises(ss.OutputExists):
        ss.segment_file(cloud, other, NEAR, overwrite=True, id_name="tree")


def test_a_look_at_what_is_there_says_nothing_of_it(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    (tmp_path / "out.csv").write_text("26,12,14,11\n26,12,14,11\n")
    np.save(tmp_path / "in.npy", np.full((2, 3), (26.0, 12.0, 14.0)))
    ss.segment_file(tmp_path / "in.npy", tmp_path / "out.xyz", NEAR)
    for suffix in ("csv", "xyz"):
        (tmp_path / f"out.{suffix}").write_text("26,12,14,11\n26,12,14,11\n")
        check_output(tmp_path / f"out.{suffix}", [tmp_path / "in.npy"], overwrite=True)
    assert not recwarn.list


@pytest.mark.parametrize("name", ["out.las", "out.laz", "out.npy", "out.csv", "out.xyz"])
def test_a_file_without_content_is_nobodys(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    assert ss.segment_file(write_las(tmp_path / "in.las"), tmp_path / name, NEAR, overwrite=True).points == 12


def test_only_our_picture_is_replaced_by_a_picture(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("precious")
    with pytest.raises(ss.OutputExists, match="is no picture"):
        check_preview(tmp_path / "a.png", overwrite=True)
    Image.new("RGB", (5, 5)).save(tmp_path / "photo.png")
    with pytest.raises(ss.OutputExists, match="is a picture that streamseg has not drawn"):
        check_preview(tmp_path / "photo.png", overwrite=True)
    ss.segment_file(write_las(tmp_path / "in.las"), tmp_path / "out.las", NEAR)
    for overwrite in (False, True):
        ss.preview(tmp_path / "out.las", tmp_path / "b.png", overwrite=overwrite)
    with pytest.raises(ss.OutputExists):
        ss.preview(tmp_path / "out.las", tmp_path / "b.png")


@pytest.mark.parametrize("name", ["*.laz", "out?.laz", "out[0-9].laz", "dir*/out.laz"])
def test_a_pattern_is_no_name(tmp_path: Path, name: str) -> None:
    (tmp_path / "out7.laz").touch()
    with pytest.raises(ss.InvalidParameter, match="allowed: the name of one file or folder, without"):
        check_output(tmp_path / name, [])
    with pytest.raises(ss.FileError, match=r"does not exist; the shell makes names of a pattern, if it is not quoted"):
        ss.segment(tmp_path / name, NEAR)
    with pytest.raises(ss.InvalidParameter, match=r"^history is .*, allowed: the name of one"):
        ss.stream(POINTS, NEAR, history=tmp_path / name)


def test_a_name_with_brackets_is_a_name(tmp_path: Path) -> None:
    cloud = write_las(tmp_path / "in.las")
    (tmp_path / "odd*").mkdir()
    names = ("survey [1].las", "scan[2024-05].las", "plot[a-c].npy", "[a-z].xyz", "odd*/out.las", "odd*/o[1-3].las")
    for name in names:
        out = tmp_path / name
        assert ss.segment_file(cloud, out, NEAR).points == 12


@pytest.fixture
def usual_mask() -> Any:
    mask = os.umask(0o022)
    yield
    os.umask(mask)


@pytest.mark.usefixtures("usual_mask")
@pytest.mark.parametrize("suffix", [".las", ".npy", ".csv"])
def test_modes_stay(tmp_path: Path, suffix: str) -> None:
    cloud, out = write_las(tmp_path / "in.las"), tmp_path / f"out{suffix}"
    ss.segment_file(cloud, out, NEAR)
    assert stat.S_IMODE(out.stat().st_mode) == 0o644
    for mode in (0o600, 0o664, 0o640):
        out.chmod(mode)
        ss.segment_file(cloud, out, NEAR, overwrite=True)
        assert stat.S_IMODE(out.stat().st_mode) == mode


def test_a_file_that_is_read_only_is_kept(tmp_path: Path) -> None:
    cloud, out = write_las(tmp_path / "in.las"), tmp_path / "out.las"
    ss.segment_file(cloud, out, NEAR)
    out.chmod(0o444)
    with pytest.raises(ss.FileError, match="it is read-only"):
        ss.segment_file(cloud, out, NEAR, overwrite=True)


def test_links_are_followed_and_stay(tmp_path: Path) -> None:
    cloud, folder = write_las(tmp_path / "in.las"), tmp_path / "elsewhere"
    folder.mkdir()
    link = tmp_path / "link.las"
    link.symlink_to(folder / "real.las")
    for distance in (1.0, 0.5):
        ss.segment_file(cloud, link, ss.Proximity(distance), overwrite=True)
        assert link.is_symlink()
        assert len(np.unique(laspy.read(folder / "real.las")["SegmentID"])) == (1 if distance == 1.0 else 12)
    assert [path.name for path in folder.iterdir()] == ["real.las"]
    os.link(folder / "real.las", tmp_path / "hard.las")
    before = (tmp_path / "hard.las").read_bytes()
    ss.segment_file(cloud, link, NEAR, overwrite=True)
    assert (tmp_path / "hard.las").read_bytes() == before  # another name keeps the old file
    (tmp_path / "to_input.las").symlink_to(cloud)
    with pytest.raises(ss.InvalidParameter, match="is the input"):
        check_output(tmp_path / "to_input.las", [cloud], overwrite=True)


def test_links_that_lead_nowhere_are_told(tmp_path: Path) -> None:
    (tmp_path / "round.las").symlink_to(tmp_path / "round.las")
    with pytest.raises(ss.FileError, match="a symbolic link that leads to itself"):
        check_output(tmp_path / "round.las", [])
    (tmp_path / "far.las").symlink_to(tmp_path / "nowhere" / "far.las")
    with pytest.raises(ss.FileError, match=r"the folder .*nowhere does not exist"):
        check_output(tmp_path / "far.las", [])


def test_pipes_and_devices_are_no_outputs(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xyz")
    (tmp_path / "null.xyz").symlink_to(os.devnull)
    for name in ("pipe.xyz", "null.xyz"):
        with pytest.raises(ss.FileError, match="it is a pipe or a device"):
            check_output(tmp_path / name, [], overwrite=True)
    with pytest.raises(ss.InvalidParameter, match="ends in ''"):
        check_output("/dev/stdout", [], overwrite=True)


def write_while(out: Path, happens: Callable[[], object], *, overwrite: bool = True) -> None:
    """Write an output; something happens before it is whole."""
    with replacing(out, overwrite=overwrite) as file:
        file.write(b"late")
        happens()


def test_a_folder_that_vanishes_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for _ in range(2):  # while it is written, and before
        with pytest.raises(ss.FileError, match=r"^cannot write .*out\.las: "):
            write_while(folder / "out.las", lambda: shutil.rmtree(folder))
    assert list(tmp_path.iterdir()) == []


def test_what_has_come_to_the_name_in_between_is_not_replaced_unasked(tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    with pytest.raises(ss.OutputExists, match="since this run began"):
        write_while(out, lambda: out.write_bytes(b"early"), overwrite=False)
    assert out.read_bytes() == b"early"
    write_while(out, lambda: out.write_bytes(b"early"))
    assert out.read_bytes() == b"late"
    with replacing(tmp_path / "new.csv", overwrite=False) as file:
        file.write(b"new")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"out.csv": b"late", "new.csv": b"new"}


KILLED = """
import os, signal, sys
from pathlib import Path
import numpy as np
from streamseg.io import LabelSpool
from streamseg.io.output import replacing
spool = LabelSpool(sys.argv[1])
spool.add(np.arange(5), np.arange(5))
spool.read(0, 1)
with replacing(Path(sys.argv[1]) / "out.csv") as file:
    file.write(b"half")
    print("ready", flush=True)
    if sys.argv[2] == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.stdin.read()
"""


def begin(folder: Path, end: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", KILLED, str(folder), end]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    return process


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_a_dead_run_has_left_goes_with_the_next_and_a_live_one_keeps_its_own(tmp_path: Path) -> None:
    for other in ("streamseg-labels-mine", ".streamseg-mine.part", ".streamseg-0123abcd-" + "0" * 32 + ".part"):
        (tmp_path / other).mkdir() if other.startswith("s") else (tmp_path / other).touch()
    mine = names(tmp_path)
    with begin(tmp_path, "dies") as process:
        process.wait()
    assert len(names(tmp_path)) == len(mine) + 2
    with begin(tmp_path, "waits") as process:
        # What the dead one has left is gone, what this one has is there.
        live = names(tmp_path)
        assert len(live) == len(mine) + 2
        with ss.io.LabelSpool(tmp_path) as spool, replacing(tmp_path / "more.csv") as file:
            spool.add([1], [2])
            file.write(b"whole")
        assert names(tmp_path) == sorted([*live, "more.csv"])
        process.communicate(b"")
        assert process.returncode == 0
    assert names(tmp_path) == sorted([*mine, "more.csv", "out.csv"])


def test_a_forked_child_takes_nothing_away(tmp_path: Path) -> None:
    with ss.io.LabelSpool(tmp_path) as spool, replacing(tmp_path / "out.csv") as file:
        spool.add([0], [7])
        file.write(b"whole")
        before = names(tmp_path)
        if (child := os.fork()) == 0:
            spool.close()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        claim_part(tmp_path).release()  # looks for what dead runs have left
        assert names(tmp_path) == before
        assert spool.read(0, 1)[0].tolist() == [7]
    assert names(tmp_path) == ["out.csv"]


def test_a_scene_appears_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = ss.scenes.write(tmp_path / "scene.laz", "street", 1000)
    before = path.read_bytes()
    monkeypatch.setattr("streamseg.scenes._CHUNK", 400)
    monkeypatch.setattr("laspy.LasWriter.write_points", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        ss.scenes.write(path, "street", 2000)
    assert path.read_bytes() == before
    assert names(tmp_path) == ["scene.laz"]


def test_a_scene_replaces_a_scene_and_nothing_else(tmp_path: Path) -> None:
    scene = ss.scenes.write(tmp_path / "scene.las", "street", 100)
    ss.scenes.write(scene, "street", 200)
    with laspy.open(scene) as reader:
        assert reader.header.point_count == 200
    (tmp_path / "empty.las").touch()
    ss.scenes.write(tmp_path / "empty.las", "street", 100)
    for path in (write_las(tmp_path / "cloud.las"), write_text(tmp_path / "notes.las")):
        before = path.read_bytes()
        with pytest.raises(ss.OutputExists, match="is no scene that streamseg has made; give another name"):
            ss.scenes.write(path, "street", 100)
        assert path.read_bytes() == before


def test_no_pipe_is_replaced_by_a_file(tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe.las", tmp_path / "link.las"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for path in (pipe, link):
        for write in (lambda path: ss.scenes.write(path, "street", 100), _write_byte):
            with pytest.raises(ss.FileError, match="it is a pipe or a device, and only files are written"):
                write(path)
    assert pipe.is_fifo()
    assert names(tmp_path) == ["link.las", "pipe.las"]


def test_a_pipe_that_comes_while_a_file_is_written_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.npy"
    with pytest.raises(ss.FileError, match="it is a pipe or a device"), replacing(pipe):
        os.mkfifo(pipe)
    assert pipe.is_fifo()
    assert names(tmp_path) == ["pipe.npy"]


def _write_byte(path: Path) -> None:
    with replacing(path) as file:
        file.write(b"a")


def test_a_second_failure_is_told_beside_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was segmented before the first is rescued; what hinders that is told, and the first is raised."""
    np.save(tmp_path / "in.npy", np.zeros((100, 3)))
    add, calls = ss.io.LabelSpool.add, []

    def failing(spool: ss.io.LabelSpool, *ids: Any) -> None:
        calls.append(ids)
        if len(calls) in (4, 6):
            raise ss.FileError(f"failure at span {len(calls)}")
        add(spool, *ids)

    monkeypatch.setattr(ss.io.LabelSpool, "add", failing)
    with (
        pytest.warns(ss.StreamsegWarning, match=r"some of .* is not in .*out\.npy: .* another: failure at span 6"),
        pytest.raises(ss.FileError, match="failure at span 4"),
    ):
        ss.segment_file(
            *(tmp_path / "in.npy", tmp_path / "out.npy", ss.Proximity(1.0)), spans=ss.SpanByCount(10), result="carry"
        )
    ids = np.load(tmp_path / "out.npy")
    assert ids.tolist() == [1] * 30 + [-1] * 10 + [1] * 10
