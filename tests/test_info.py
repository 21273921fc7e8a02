"""What `info` proposes is run for real, and does what it is there for."""

import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

from reference.interiors import room, wall
from streamseg import description
from streamseg.description import describe, sample
from streamseg.description.sample import WHOLE
from streamseg.io import open_cloud

Told = dict[str, str]


def told(path: Path) -> Told:
    """The lines by their labels; of several with one label the first."""
    lines: Told = {}
    for label, value in describe(path):
        lines.setdefault(label, value)
    return lines


def streamseg(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "streamseg", *map(str, words)], capture_output=True, text=True, check=False
    )


class Figures(NamedTuple):
    labelled: float
    in_small: float
    largest: float
    segments: int


def run_proposal(command: str, folder: Path) -> Figures:
    """Run what can be pasted, and count."""
    words = shlex.split(command)
    assert words[0] == "streamseg"
    out = next(word for word in words if word.startswith("OUT."))
    done = streamseg(*(folder / word if word == out else word for word in words[1:]))
    assert done.returncode == 0, done.stderr
    output = folder / out
    ids = np.load(output) if output.suffix == ".npy" else np.asarray(laspy.read(output).SegmentID)
    counts = np.bincount(ids[ids >= 0])
    counts = counts[counts > 0]
    return Figures(
        np.count_nonzero(ids >= 0) / len(ids),
        counts[counts < 10].sum() / len(ids),
        counts.max() / len(ids),
        len(counts),
    )


def saved(folder: Path, points: NDArray[np.floating]) -> Path:
    np.save(folder / "cloud.npy", points)
    return folder / "cloud.npy"


def of_kitti(path: Path, folder: Path) -> Path:
    return saved(folder, np.fromfile(path, np.float32).reshape(-1, 4)[:, :3])


MEASURED = [
    "als/bcts_2.laz",
    "als/mixed_conifer.laz",
    "als/topography.laz",
    "spinning/kitti_a.bin",
    "tls/lone_star.laz",
]


@pytest.mark.parametrize("name", MEASURED)
def test_the_first_proposal_does_what_is_wanted(name: str, data: Path, tmp_path: Path) -> None:
    path = of_kitti(data / name, tmp_path) if name.endswith(".bin") else data / name
    found = run_proposal(told(path)["try"], tmp_path)
    assert found.labelled >= 0.7
    assert found.in_small < 0.1
    assert found.largest <= 0.9
    assert found.segments > 5


def test_a_room_is_taken_apart_into_planes(tmp_path: Path) -> None:
    lines = told(saved(tmp_path, room()))
    assert "--method planes" in lines["try"]
    assert lines["up"].startswith("seems to be y")
    found = run_proposal(lines["try"], tmp_path)
    assert found.labelled > 0.95
    assert 15 <= found.segments <= 30


def test_a_room_that_stands_on_z_is_not_said_to_lie(tmp_path: Path) -> None:
    assert "up" not in told(saved(tmp_path, room()[:, [0, 2, 1]]))


@pytest.mark.parametrize("across", [1, 5])
def test_a_wall_is_one_segment(across: int, tmp_path: Path) -> None:
    """Also if its scan lines are five times as far apart as the points on them."""
    points = wall(noise=0.001)
    points[:, 2] *= across
    lines = told(saved(tmp_path, points))
    assert "--graph radius" in lines["try"]
    assert lines["flat"].startswith("one surface that faces y")
    found = run_proposal(lines["try"], tmp_path)
    assert found.segments == 1
    assert found.labelled == 1


def test_every_proposal_runs(tmp_path: Path, data: Path) -> None:
    site = data / "als" / "autzen_trim.laz"
    lines = [(label, value) for label, value in describe(site) if label in ("try", "or")]
    assert [label for label, _ in lines] == ["try", *["or"] * (len(lines) - 1)]
    assert {method for method in ("planes", "growing") for _, value in lines if method in value} == {
        "planes",
        "growing",
    }
    for number, (_, value) in enumerate(lines):
        folder = tmp_path / str(number)
        folder.mkdir()
        assert run_proposal(value, folder).labelled > 0.5


def test_the_order_of_the_points_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cloud is larger than a sample: which places are looked at must not depend on the file either."""
    monkeypatch.setattr(sample, "POINTS_PER_BLOCK", 2_000)
    monkeypatch.setattr(sample, "WHOLE", 16_000)
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.random((30_000, 2)) * 100, rng.normal(0, 0.05, 30_000)])
    points[:10_000, 2] += 4
    lines = told(saved(tmp_path, points))
    shuffled = told(saved(tmp_path, rng.permutation(points)))
    assert "in a sample" in lines[""]
    assert shuffled == lines


FEW = {
    "one": np.ones((1, 3)),
    "two": np.array([[0.0, 0, 0], [1, 1, 1]]),
    "all at one place": np.ones((WHOLE + 1, 3)),
    "two places": np.repeat(np.eye(3)[:2], 500, axis=0),
    "none is finite": np.full((40, 3), np.nan),
    "beyond measure": np.random.default_rng(0).random((500, 3)) * 1e308,
    "below measure": np.random.default_rng(0).random((500, 3)) * 1e-200,
}


@pytest.mark.parametrize("case", FEW)
def test_where_too_little_is_known_nothing_is_proposed(case: str, tmp_path: Path) -> None:
    lines = told(saved(tmp_path, FEW[case]))
    assert lines["points"] == f"{len(FEW[case]):,}"
    assert "try" not in lines
    assert lines["no proposal"]


THIN = {
    "a line along x": np.column_stack([np.arange(500) * 0.1, np.zeros(500), np.zeros(500)]),
    "a slanted line": np.arange(500)[:, None] * [0.1, 0.2, 0.3],
    "an upright line": np.column_stack([np.zeros(500), np.zeros(500), np.arange(500) * 0.1]),
    "a level grid": np.stack([*np.meshgrid(np.arange(30.0), np.arange(30.0)), np.zeros((30, 30))], axis=-1).reshape(
        -1, 3
    ),
}


@pytest.mark.parametrize("case", THIN)
def test_what_hangs_together_stays_together(case: str, tmp_path: Path) -> None:
    lines = told(saved(tmp_path, THIN[case]))
    assert run_proposal(lines["try"], tmp_path).segments == 1


def test_equal_points_are_no_neighbors(tmp_path: Path) -> None:
    once = np.random.default_rng(5).random((2000, 3))
    lines = told(saved(tmp_path, once))
    assert told(saved(tmp_path, np.repeat(once, 10, axis=0)))["spacing"] == lines["spacing"]


def test_spacing_in_space_and_on_the_map(tmp_path: Path) -> None:
    floors = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), np.arange(2.0)), axis=-1).reshape(-1, 3)
    lines = told(saved(tmp_path, floors * [1, 1, 3]))
    assert lines["spacing"].startswith("about 1 in space, 1 on the map")
    assert "layers" not in lines  # 3 is not much more than 1
    assert told(saved(tmp_path, floors * [1, 1, 20]))["layers"].startswith("100 %")


def test_invalid_points_are_dropped_by_the_proposal(tmp_path: Path) -> None:
    points = room()[::4]
    points[::9, 1] = np.nan
    lines = told(saved(tmp_path, points))
    assert lines["invalid"].startswith(f"{len(points[::9]):,} of {len(points):,} points")
    assert run_proposal(lines["try"], tmp_path).labelled > 0.7


@pytest.mark.parametrize("name", ["with space.npy", "it's $HOME;.npy", "-dash.npy"])
def test_commands_can_be_pasted(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save(name, wall()[::3])
    assert run_proposal(told(Path(name))["try"], tmp_path).labelled > 0.9


def las(path: Path, **dimensions: object) -> Path:
    points = wall()[:3000]
    made = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    made.header.scales = [0.0001] * 3
    made.x, made.y, made.z = points.T
    for name, values in dimensions.items():
        setattr(made, name, np.resize(np.asarray(values), len(points)))
    made.write(path)
    return path


def test_classes_returns_and_time(tmp_path: Path) -> None:
    path = las(tmp_path / "a.las", classification=[2, 6, 6, 200], number_of_returns=[1, 2, 2, 2], gps_time=[0.0])
    lines = told(path)
    assert lines["classes"] == "750 ground (2); 1,500 building (6); 750 class 200"
    assert lines["returns"].startswith("75 %")
    assert lines["order"].endswith("in the order of gps_time")
    assert told(las(tmp_path / "b.las", gps_time=[1.0, 0.0]))["order"].endswith("not in the order of gps_time")


def test_which_columns_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    np.savetxt(path, wall()[:100, [2, 1, 0]], delimiter=",", header="height,y,x", comments="")
    assert told(path)["columns"] == "x, y and z are column 3 (x), column 2 (y) and column 1 (height)"


def test_numbers_that_are_no_classes_are_not_listed(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = np.column_stack([wall()[:300], np.linspace(0, 1, 300)])
    np.savetxt(path, rows, delimiter=",", header="x,y,z,classification", comments="")
    assert "classes" not in told(path)


def test_degrees_are_to_be_projected_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = las(tmp_path / "a.las")

    def opened(given: Path) -> object:
        cloud = open_cloud(given)
        cloud.coordinate_system = SimpleNamespace(  # type: ignore[attr-defined]
            name="WGS 84", unit="degree", vertical_unit="metre", is_geographic=True
        )
        return cloud

    monkeypatch.setattr(description, "open_cloud", opened)
    lines = told(path)
    assert lines["system"] == "WGS 84, unit degree, of heights metre"
    assert "degrees" in lines["degrees"]
    assert re.search(r"out_srs=EPSG:32[67]31$", lines["project"])  # it lies about the equator
    assert "try" not in lines


def test_a_distance_below_the_spacing_is_warned_of(tmp_path: Path) -> None:
    path = saved(tmp_path, wall())
    done = streamseg("segment", path, tmp_path / "out.npy", "--distance", 0.001, "--quiet")
    assert done.returncode == 0
    assert "--distance 0.001 joins next to nothing" in done.stderr
    assert "streamseg info" in done.stderr
    raw = ("--result", "history", "--history", tmp_path / "h")
    for words in (("segment", path, tmp_path / "raw.npy", *raw), ("verify", path)):
        assert "--distance 0.001 joins next to nothing" in streamseg(*words, "--distance", 0.001).stderr


def test_a_distance_beyond_the_extent_is_told(tmp_path: Path) -> None:
    path = saved(tmp_path, wall())
    done = streamseg("segment", path, tmp_path / "out.npy", "--distance", 10)
    assert "only one segment" in done.stdout
    assert "--distance 10 is too far" in done.stdout
    assert "--distance 10 is too far" in streamseg("verify", path, "--distance", 10).stdout
    fine = streamseg("segment", path, tmp_path / "two.npy", "--distance", 0.02, "--graph", "radius")
    assert "too far" not in fine.stdout
    assert not fine.stderr


@pytest.mark.parametrize(("method", "option"), [("proximity", "--distance"), ("dbscan", "--eps")])
def test_a_missing_distance_points_to_info(method: str, option: str, tmp_path: Path) -> None:
    done = streamseg("segment", saved(tmp_path, wall()), tmp_path / "out.npy", "--method", method)
    assert done.returncode == 2
    assert done.stderr.strip() == f"streamseg: --method {method} needs {option}; streamseg info FILE proposes one"
