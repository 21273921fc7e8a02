"""Every method and every option of `streamseg segment`, on a small file: what it does, and what is refused."""

from __future__ import annotations

import inspect
import re
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference.partition import same
from reference.roster import houses
from streamseg.cli import main
from streamseg.cli.methods import METHODS, OPTIONS
from streamseg.cli.segment import segment
from streamseg.cli.verify import verify


class Done(NamedTuple):
    """How a command ended."""

    status: int
    out: str
    err: str


Run = Callable[..., Done]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command line in this process, which is ten times faster."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    monkeypatch.setenv("NO_COLOR", "1")

    def run(*words: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["streamseg", *map(str, words)])
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            with pytest.raises(SystemExit) as ended:
                main()
        told = capsys.readouterr()
        code = ended.value.code
        return Done(code if isinstance(code, int) else 0, told.out, told.err)

    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("houses")


@pytest.fixture(scope="module")
def village(folder: Path) -> Path:
    """Houses with classes, intensities and a dimension of their own."""
    points = houses(90, 900)
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = [0.125] * 3
    las = laspy.LasData(header)
    las.xyz = points
    random = np.random.default_rng(1)
    las.classification = np.where(points[:, 2] > 3, 6, 2)
    las.intensity = random.integers(0, 500, len(points))
    las.add_extra_dim(laspy.ExtraBytesParams("Pulse width", "f4"))
    las["Pulse width"] = random.integers(0, 3, len(points))
    las.write(folder / "village.las")
    return folder / "village.las"


def ids(path: Path) -> NDArray[np.int64]:
    return np.asarray(laspy.read(path)["SegmentID"], np.int64)


PULSE = "[Pulse width] == n[0].[Pulse width]"
CALCULATOR = "NormalSigma0 < 0.1 ? -Z : invalid"

# Words of the command line, and the segmentor that they make.
METHOD_OPTIONS: list[tuple[str, Any]] = [
    ("--distance 0.8", ss.Proximity(0.8)),
    ("--method proximity --distance 0.8 --metric xy", ss.Proximity(0.8, metric="xy")),
    ("--distance 0.6 --graph radius", ss.Proximity(0.6, graph="radius")),
    ("--method dbscan --eps 0.8", ss.Dbscan(0.8)),
    ("--method dbscan --eps 0.5 --min-points 3 --metric xy", ss.Dbscan(0.5, 3, "xy")),
    ("--method conditional", ss.ConditionalClustering()),
    (f"--method conditional --criterion '{PULSE}' --min-size 1", ss.ConditionalClustering(PULSE, min_segment_size=1)),
    ("--method conditional --search-radius 0.6", ss.ConditionalClustering(search_radius=0.6)),
    (
        "--method conditional --search-radius 0.6,0.25 --search-mode 2.5d",
        ss.ConditionalClustering(search_radius=(0.6, 0.25), search_mode="2.5d"),
    ),
    ("--method planes", ss.PlaneExtraction()),
    (
        "--method planes --search-radius 1 --k 12 --tile-size 9 --min-size 10",
        ss.PlaneExtraction(1.0, k=12, tile_size=9.0, min_segment_size=10),
    ),
    (
        f"--method planes --search-radius 1.5 --max-distance 0.2 --max-sigma 0.1 --angle 15"
        f" --seed-calculator '{CALCULATOR}' --min-size 10",
        ss.PlaneExtraction(
            1.5, max_distance=0.2, max_sigma=0.1, min_angle_deg=15.0, seed_calculator=CALCULATOR, min_segment_size=10
        ),
    ),
    (
        "--method planes --search-radius 1 --search-mode 2d --min-size 10",
        ss.PlaneExtraction(1.0, search_mode="2d", min_segment_size=10),
    ),
    ("--method growing", ss.RegionGrowing()),
    (
        "--method growing --k 12 --search-radius 2 --angle 20 --max-curvature 0.1 --residual 0.3",
        ss.RegionGrowing(12, search_radius=2.0, angle_deg=20.0, max_curvature=0.1, residual=0.3),
    ),
    (
        "--method growing --search-radius 2 --curvature principal --max-curvature 1",
        ss.RegionGrowing(search_radius=2.0, curvature="principal", max_curvature=1.0),
    ),
    ("--method growing --literal --k 16", ss.RegionGrowing(16, literal=True)),
    (
        "--method dbscan --eps 0.8 --filter 'Class[6]' --min-size 5 --max-size 400 --sort descending",
        ss.Dbscan(0.8, filter="Class[6]", min_segment_size=5, max_segment_size=400, sort="descending"),
    ),
    (
        "--distance 0.8 --seed-filter 'Intensity > 480' --sort ascending",
        ss.Proximity(0.8, seed_filter="Intensity > 480", sort="ascending"),
    ),
    (
        "--method growing --search-radius 1.5 --normals robust",
        ss.RegionGrowing(search_radius=1.5, normals="robust"),
    ),
]


def words(text: str) -> list[str]:
    """Split as a shell does, single quotes included."""
    parts = text.split("'")
    return [word for nth, part in enumerate(parts) for word in ([part] if nth % 2 else part.split())]


@pytest.mark.parametrize(
    ("text", "segmentor"), METHOD_OPTIONS, ids=lambda value: value if isinstance(value, str) else ""
)
def test_a_method_with_its_options(run: Run, village: Path, tmp_path: Path, text: str, segmentor: Any) -> None:
    done = run("segment", village, "out.las", *words(text), "--span-width", 5)
    assert done.status == 0, done.err
    assert done.err == ""
    labels = ids(tmp_path / "out.las")
    np.testing.assert_array_equal(labels, ss.segment(village, segmentor, spans=ss.SpanByWidth(5.0)))
    found = len(np.unique(labels[labels > 0]))
    of_all = f"{np.count_nonzero(labels > 0):,} of " if np.any(labels < 0) else ""
    assert f"out.las: {of_all}{len(labels):,} points in {found:,} segment" in done.out


def test_every_option_is_tried_above() -> None:
    tried = {word for text, _ in METHOD_OPTIONS for word in words(text) if word.startswith("--")}
    assert tried == {"--method", *OPTIONS, *(option for method in METHODS.values() for option in method.options)}


BEFORE: list[tuple[str, list[Any]]] = [
    ("--outliers 8", [ss.StatisticalOutlierRemoval(8)]),
    ("--outliers 6,1.5", [ss.StatisticalOutlierRemoval(6, 1.5)]),
    ("--outliers 6,1.5,open3d", [ss.StatisticalOutlierRemoval(6, 1.5, "open3d")]),
    ("--lonely 0.7", [ss.RadiusOutlierRemoval(0.7)]),
    ("--lonely 0.7,5", [ss.RadiusOutlierRemoval(0.7, 5)]),
    ("--voxel 0.5", [ss.VoxelGrid(0.5)]),
    (
        "--voxel 0.5 --lonely 0.7,5 --outliers 6,3",
        [ss.StatisticalOutlierRemoval(6, 3.0), ss.RadiusOutlierRemoval(0.7, 5), ss.VoxelGrid(0.5)],
    ),
]


@pytest.mark.parametrize(("text", "stages"), BEFORE, ids=lambda value: value if isinstance(value, str) else "")
def test_what_is_done_before(run: Run, village: Path, tmp_path: Path, text: str, stages: list[Any]) -> None:
    done = run("segment", village, "out.las", "--method", "dbscan", "--eps", 0.9, *text.split(), "--span-width", 6)
    assert done.status == 0, done.err
    expected = ss.segment(village, ss.Dbscan(0.9), preprocess=stages, spans=ss.SpanByWidth(6.0))
    np.testing.assert_array_equal(ids(tmp_path / "out.las"), expected)
    assert same(expected, ss.segment_static(village, ss.Dbscan(0.9), preprocess=stages))


def test_what_is_left_out_is_told(run: Run, village: Path) -> None:
    done = run("segment", village, "out.las", "--method", "dbscan", "--eps", 0.8, "--min-size", 20)
    assert "segments smaller than 20 points" in done.out
    done = run("segment", village, "two.las", "--method", "dbscan", "--eps", 0.8, "--seed-filter", "false")
    assert "in 0 segments" in done.out
    assert "without a seed" in done.out
    assert "more points would be in one with another --seed-filter" in done.out
    assert np.all(ids(Path("two.las")) == -1)


def test_an_order_by_size_needs_final_ids(run: Run, village: Path) -> None:
    done = run("segment", village, "out.las", "--distance", 1, "--sort", "ascending", "--result", "carry")
    assert done.status == 2
    assert done.err.startswith("streamseg: --sort is 'ascending' with --result carry, allowed: with --result final, ")


def test_the_class_of_the_run_is_told(run: Run, village: Path) -> None:
    told = run("segment", village, "a.las", "--method", "dbscan", "--eps", 0.8).out
    assert "equal to the static result" in told
    told = run("segment", village, "b.las", "--method", "growing", "--literal", "--search-radius", 1).out
    assert "no promise of equality" in told
    done = run("segment", village, "c.las", "--method", "dbscan", "--eps", 0.8, "--span-width", 0.5)
    assert done.status == 0
    assert "streamseg: warning: windows overlap by 0.5, less than the distance 0.8" in done.err


# What is refused.

WRONG: dict[str, tuple[str, list[str]]] = {
    "no such method": (
        "--method hdbscan2",
        ["streamseg: --method is 'hdbscan2', allowed: proximity, dbscan, conditional, planes"],
    ),
    "proximity needs": ("--method proximity", ["streamseg: --method proximity needs --distance"]),
    "dbscan needs": ("--method dbscan --min-points 4", ["streamseg: --method dbscan needs --eps"]),
    "of another method": (
        "--method dbscan --eps 1 --distance 2",
        ["streamseg: --distance is given with --method dbscan, allowed there: --eps, --min-points, --metric"],
    ),
    "growing has no criterion": (
        "--method growing --criterion true",
        ["streamseg: --criterion is given with --method growing, allowed there: --k"],
    ),
    "planes are not literal": ("--method planes --literal", ["streamseg: --literal is given with --method planes"]),
    "conditional has no k": ("--method conditional --k 8", ["streamseg: --k is given with --method conditional"]),
    "proximity has no radius": (
        "--distance 1 --search-radius 2",
        ["streamseg: --search-radius is given with --method proximity"],
    ),
    "set with ours": (
        "--distance 1 --set eps=1",
        ["streamseg: --set eps=1 is given with --method proximity, allowed: with"],
    ),
    "radius": (
        "--method conditional --search-radius wide",
        ["streamseg: --search-radius is 'wide', allowed: a number"],
    ),
    "radii": (
        "--method conditional --search-radius 1,2,3,4 --search-mode 2.5d",
        ["streamseg: --search-radius is (1.0, 2.0, 3.0, 4.0), allowed: "],
    ),
    "radius below 0": (
        "--method planes --search-radius -1",
        ["streamseg: --search-radius is -1, allowed: a finite number above 0"],
    ),
    "mode": (
        "--method conditional --search-mode 3",
        ["streamseg: --search-mode is '3', allowed: '2d', '2.5d' or '3d'"],
    ),
    "criterion": (
        "--method conditional --criterion 'abs(Z-n[0].Z)<'",
        ["streamseg: criterion, column 15: ", "abs(Z-n[0].Z)<"],
    ),
    "no such attribute": (
        "--method conditional --criterion 'Amplitude == n[0].Amplitude'",
        ["streamseg: criterion, column 1: there is no attribute 'Amplitude'", "there are: X, Y, Z", "Pulse width"],
    ),
    "filter": ("--distance 1 --filter 'Z > '", ["streamseg: filter, column"]),
    "no neighborhood": ("--distance 1 --filter 'NormalZ > 0'", ["streamseg: NormalZ is no attribute of the cloud"]),
    "calculator": ("--method planes --seed-calculator 'Z > 1'", ["streamseg: calculator, column 1: ", "true or false"]),
    "angle": ("--method growing --angle 120", ["streamseg: --angle is 120, allowed: "]),
    "planes' angle": ("--method planes --angle -4", ["streamseg: --angle is -4, allowed: "]),
    "curvature": ("--method growing --curvature gauss", ["streamseg: --curvature is 'gauss', allowed: "]),
    "size": ("--distance 1 --min-size 0", ["streamseg: --min-size is 0, allowed: "]),
    "sizes": ("--distance 1 --min-size 9 --max-size 3", ["streamseg: --max-size is 3 with a --min-size of 9"]),
    "sort": (
        "--distance 1 --sort random",
        ["streamseg: --sort is 'random', allowed: 'native', 'ascending' or 'descending'"],
    ),
    "normals": (
        "--distance 1 --normals fmcd",
        ["streamseg: --normals is 'fmcd', allowed: 'least_squares' or 'robust'"],
    ),
    "outliers": ("--distance 1 --outliers many", ["streamseg: --outliers has 'many' where a whole number is needed"]),
    "outliers' k": ("--distance 1 --outliers 0", ["streamseg: --outliers is 0, allowed: "]),
    "half a neighbor": (
        "--distance 1 --outliers 6.5",
        ["streamseg: --outliers has '6.5' where a whole number is needed"],
    ),
    "endless neighbors": (
        "--distance 1 --outliers inf",
        ["streamseg: --outliers has 'inf' where a whole number is needed"],
    ),
    "outliers' dialect": ("--distance 1 --outliers 8,2,cgal", ["streamseg: --outliers is 'cgal', allowed: "]),
    "too much of outliers": ("--distance 1 --outliers 8,2,pcl,3", ["streamseg: --outliers is '8,2,pcl,3', allowed: "]),
    "lonely": ("--distance 1 --lonely -2,3", ["streamseg: --lonely is -2, allowed: "]),
    "too much of lonely": ("--distance 1 --lonely 1,2,3", ["streamseg: --lonely is '1,2,3', allowed: "]),
    "voxel": ("--distance 1 --voxel 0", ["streamseg: --voxel is 0, allowed: "]),
    "outliers' multiplier": ("--distance 1 --outliers 8,-2", ["streamseg: --outliers is -2, allowed: "]),
    "too many outliers": (
        f"--distance 1 --outliers {'9' * 3000}",
        [f"streamseg: --outliers is {'9' * 40}…, allowed: a whole number below 2^63"],
    ),
    "lonely's neighbors": ("--distance 1 --lonely 2,0", ["streamseg: --lonely is 0, allowed: "]),
    "voxels of nothing": ("--distance 1 --voxel 1e-15", ["streamseg: --voxel is 0.000000000000001, with a point at "]),
    "width": ("--distance 1 --span-width 0", ["streamseg: --span-width is 0, allowed: "]),
    "width in words": (
        "--distance 1 --span-width wide",
        ["streamseg: --span-width is 'wide', allowed: a number above"],
    ),
    "count": ("--distance 1 --span-count 0", ["streamseg: --span-count is 0, allowed: "]),
    "time": ("--distance 1 --span-time -1", ["streamseg: --span-time is -1, allowed: "]),
    "lines": ("--distance 1 --span-lines 0", ["streamseg: --span-lines is 0, allowed: "]),
    "direction": ("--distance 1 --direction nan", ["streamseg: --direction is NaN, allowed: 'x', 'y' or an azimuth"]),
    "direction of a count": (
        "--distance 1 --span-count 9 --direction y",
        ["streamseg: --direction is given with --span-count, allowed: with --span-width"],
    ),
    "direction without a width": (
        "--method growing --k 8 --direction x",
        ["streamseg: --direction is x without --span-width, allowed: with one for RegionGrowing("],
    ),
    "spans": ("--distance 1 --spans 0", ["streamseg: --spans is 0, allowed: "]),
    "overlap": ("--distance 1 --overlap 3", ["streamseg: --overlap is 3 of 3 spans, allowed: "]),
    "threads": ("--distance 1 --threads 0", ["streamseg: --threads is 0, allowed: "]),
    "memory": ("--distance 1 --max-memory 5Q", ["streamseg: --max-memory is '5Q', allowed: "]),
    "not a number": ("--distance near", ["--distance"]),
    "no such option": ("--distance 1 --neighbours 8", ["--neighbours"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_told_in_a_sentence(run: Run, village: Path, tmp_path: Path, case: str) -> None:
    text, expected = WRONG[case]
    done = run("segment", village, "out.las", *words(text))
    assert done.status == 2
    for part in expected:
        assert part in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *[("--span-width", "5"), ("--span-count", "9"), ("--span-time", "2"), ("--span-lines", "3")],
        *[("--direction", "y"), ("--direction", "x"), ("--spans", "4"), ("--overlap", "0")],
    ],
)
def test_what_a_plan_chooses_is_not_given(run: Run, village: Path, option: str, value: str) -> None:
    planners = {
        "--plan": ["info", village, "--plan"],
        "--max-memory": ["segment", village, "out.las", "--max-memory", "1GB"],
    }
    if option != "--span-width":
        planners["--span-width auto"] = ["verify", village, "--span-width", "auto"]
    for planner, command in planners.items():
        done = run(*command, "--distance", 1, option, value)
        assert (done.status, done.out) == (2, "")
        assert done.err == f"streamseg: {option} is given with {planner}, which chooses it; leave it out\n"


def test_the_threads_of_a_plan_are_checked(run: Run, village: Path) -> None:
    for threads in (0, -3):
        done = run("info", village, "--plan", "--distance", 1, "--threads", threads)
        assert done.status == 2
        assert done.err.startswith(f"streamseg: --threads is {threads}, allowed: ")


def test_the_size_of_a_picture_is_no_voxel(run: Run, village: Path) -> None:
    done = run("preview", village, "out.png", "--size", 0)
    assert (done.status, done.err) == (2, "streamseg: --size is 0, must be 200 to 20000 pixels\n")


def test_numbers_that_are_slips_are_refused(run: Run, tmp_path: Path) -> None:
    for text in ("demo new --seed NUMBER", "demo new --points NUMBER", "segment in out --method growing --k NUMBER"):
        for number in (10**20, "9" * 5000):
            done = run(*text.replace("NUMBER", str(number)).split())
            assert (done.status, done.out) == (2, "")
            assert "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


def test_out_is_missing_where_one_path_is_given(run: Run, village: Path) -> None:
    done = run("segment", village, "--distance", 1)
    assert (done.status, done.err) == (2, "streamseg: OUT is missing: streamseg segment IN... OUT\n")
    done = run("resolve", "past", village)
    assert (done.status, done.err) == (2, "streamseg: OUT is missing: streamseg resolve HISTORY IN... OUT\n")
    for words in (["segment"], ["resolve", "past"], ["verify"]):
        done = run(*words)
        assert done.status == 2
        assert "Missing argument 'IN...'" in done.err


def test_warnings_name_options(run: Run, village: Path) -> None:
    done = run("segment", village, "out.las", "--distance", 1, "--max-memory", "82MB")
    assert done.status == 0
    assert re.match("streamseg: warning: .* more than the --max-memory of 82 MB; ", done.err)


# Asked to end.

COMMANDS = {
    "segment in.las out.las --distance 1": "cli.segment.segment_file",
    "verify in.las --distance 1": "cli.verify.verify_run",
    "resolve past in.las out.las": "cli.commands.resolved_file",
    "info in.las": "description.describe",
    "info in.las --plan --distance 1": "cli.plan.plan",
    "preview in.las out.png": "cli.commands.draw_preview",
    "export past tables": "cli.commands.History",
    "demo new": "demo.run",
}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_ends_alike_when_it_is_asked_to(
    run: Run, monkeypatch: pytest.MonkeyPatch, command: str, number: signal.Signals
) -> None:
    def work(*_: object, **__: object) -> None:
        signal.raise_signal(number)

    monkeypatch.setattr(f"streamseg.{COMMANDS[command]}", work)
    before = {each: signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGHUP)}
    try:
        done = run(*command.split())
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
    assert done.status == 128 + number
    assert re.fullmatch("streamseg: interrupted(; out.las has not been written, because no .*)?\n", done.err)


# Plug-ins.


BANDS = """
import numpy as np

class Bands:
    def __init__(self, height=1.0, axis="z"):
        if not isinstance(height, (int, float)):
            raise TypeError(f"height is {height!r}")
        self.height, self.axis = height, "xyz".index(axis)

    def fit_predict(self, points):
        return np.floor(np.clip(points[:, self.axis], 0, None) / self.height).astype(np.int64)
"""


@pytest.fixture
def plugged_in(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package that announces a segmentor, as if it were installed."""
    site = tmp_path_factory.mktemp("site")
    (site / "height_bands.py").write_text(BANDS)
    info = site / "height_bands-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: height-bands\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[streamseg.segmentors]\nbands = height_bands:Bands\n")
    monkeypatch.syspath_prepend(site)


@pytest.mark.usefixtures("plugged_in")
def test_a_plug_in_and_its_settings(run: Run, village: Path, tmp_path: Path) -> None:
    done = run("segment", village, "out.las", "--method", "bands", "--set", "height=2.5", "--set", "axis=z")
    assert done.status == 0, done.err
    heights = np.asarray(laspy.read(village).z)
    assert same(ids(tmp_path / "out.las"), np.floor(np.clip(heights, 0, None) / 2.5).astype(np.int64))
    for text, sentence in [
        ("--method bands --set height", "--set is 'height', allowed: NAME=VALUE"),
        ("--method bands --set 2=3", "--set is '2=3', allowed: NAME=VALUE"),
        ("--method bands --set depth=3", "segmentor 'bands' does not take these parameters"),
        ("--method bands --set height=tall", "segmentor 'bands' does not take these parameters"),
        ("--method bands --distance 3", "--distance is given with --method bands, allowed: --set NAME=VALUE"),
        ("--method stripes", "allowed: proximity, dbscan, conditional, planes, growing, bands"),
    ]:
        done = run("segment", village, "wrong.las", *words(text))
        assert done.status == 2
        assert sentence in done.err


# Streamed against static.


def test_verify_says_whether_it_is_identical(run: Run, village: Path, tmp_path: Path) -> None:
    done = run("verify", village, *words("--distance 0.3 --metric xy --span-width 2 --threads 2"))
    assert (done.status, done.err) == (0, "")
    assert done.out.startswith("identical: 900 points in ")
    done = run("verify", village, *words("--distance 0.8 --span-count 60"))
    assert done.status == 3
    assert done.out.startswith("not identical: ")
    assert "1. the spans are in stream order" in done.out
    done = run("verify", village, village, *words("--distance 0.8 --span-count 60 --quiet"))
    assert (done.status, done.out) == (3, "")
    assert "is given more than once" in done.err
    assert list(tmp_path.iterdir()) == [], "it writes nothing"


@pytest.mark.parametrize("case", METHOD_OPTIONS, ids=lambda case: case[0])
def test_verify_takes_the_methods_and_options_of_segment(run: Run, village: Path, case: tuple[str, Any]) -> None:
    text, segmentor = case
    done = run("verify", village, *words(text), *words("--outliers 8 --span-width 4"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.StreamsegWarning)
        expected = ss.verify(village, segmentor, preprocess=ss.StatisticalOutlierRemoval(8), spans=ss.SpanByWidth(4.0))
    assert done.out == str(expected).replace("give a search_radius", "give a --search-radius") + "\n"
    assert done.status == (0 if expected.is_identical else 3)


def test_verify_has_the_options_of_segment() -> None:
    output = {"output", "result", "history", "preview", "overwrite", "id_name"}
    assert set(inspect.signature(verify).parameters) == set(inspect.signature(segment).parameters) - output


# What is handed on of the options that are not the segmentor's.
HANDED_ON: list[tuple[str, str, Any]] = [
    *[(text, "preprocess", stages) for text, stages in BEFORE],
    ("--span-width 5", "spans", ss.SpanByWidth(5.0)),
    ("--span-width 5 --direction 30", "spans", ss.SpanByWidth(5.0, 30.0)),
    ("--direction y", "spans", ss.SpanByWidth(20.0, "y")),
    ("--span-width auto", "spans", "auto"),
    ("--span-count 60", "spans", ss.SpanByCount(60)),
    ("--span-time 0.5", "spans", ss.SpanByTime(0.5)),
    ("--span-lines 7", "spans", ss.SpanByScanLine(7)),
    ("--spans 5", "window", ss.Window(5, 1)),
    ("--overlap 2", "window", ss.Window(3, 2)),
    ("--spans 5 --overlap 0", "window", ss.Window(5, 0)),
    ("--max-memory 99MB", "max_memory", "99MB"),
    ("--threads 2", "threads", 2),
    ("--drop-invalid", "drop_invalid", True),
    ("--revisit", "revisit", True),
]


@pytest.mark.parametrize("command", ["segment", "verify"])
@pytest.mark.parametrize(("text", "keyword", "value"), HANDED_ON)
def test_each_option_is_handed_on(
    run: Run, village: Path, monkeypatch: pytest.MonkeyPatch, command: str, text: str, keyword: str, value: Any
) -> None:
    handed: list[dict[str, Any]] = []

    def work(*_: object, **keywords: Any) -> None:
        handed.append(keywords)
        raise KeyboardInterrupt

    monkeypatch.setattr(f"streamseg.cli.{'verify.verify_run' if command == 'verify' else 'segment.segment_file'}", work)
    paths = [village] if command == "verify" else [village, "out.las"]
    run(command, *paths, "--distance", 1)
    run(command, *paths, "--distance", 1, *text.split())
    usual, given = handed
    assert repr(given["segmentor"]) == repr(ss.Proximity(1.0))
    assert repr(given[keyword]) == repr(value) != repr(usual[keyword])


def test_every_shared_option_is_tried_above() -> None:
    tried = {word for text, *_ in [*HANDED_ON, *METHOD_OPTIONS] for word in words(text) if word.startswith("--")}
    options = {f"--{name.replace('_', '-')}" for name in inspect.signature(verify).parameters}
    assert tried == options - {"--inputs", "--settings", "--quiet"}


def test_verify_advises_what_can_be_typed(run: Run, village: Path) -> None:
    done = run("verify", village, *words("--method growing --search-radius 2 --span-count 60"))
    assert done.status == 3
    assert "use spans by width, or --revisit" in done.out
    assert "=True" not in done.out


def test_verify_of_a_damaged_file(run: Run, village: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.las").write_bytes(village.read_bytes()[:-5000])
    done = run("verify", "cut.las", *words("--distance 0.3 --metric xy"))
    assert done.status == 2
    assert "damaged" in done.err
    assert done.out.startswith("identical: ")


def test_verify_refuses_what_segment_refuses(run: Run, village: Path) -> None:
    for text, sentence in [
        ("--method dbscan --eps 1 --k 8", "--k is given with --method dbscan"),
        ("--distance 1 --span-width 5 --span-count 9", "--span-width and --span-count are given"),
        ("--distance 1 --span-width 0", "streamseg: --span-width is 0"),
        ("--distance 1 --history past", "--history"),
    ]:
        done = run("verify", village, *words(text))
        assert done.status == 2
        assert sentence in done.err
    assert run("verify", "no.laz", *words("--distance 1")).status == 2


def test_segment_tells_what_it_could_prove(run: Run, village: Path) -> None:
    done = run("segment", village, "out.las", *words("--method growing --search-radius 2 --span-width 5"))
    assert done.status == 0
    assert re.search(
        r"^certificate: 0 points undecided in [\d,]+ decisions; equal to the static result, proven$", done.out, re.M
    )
    done = run("segment", village, "other.las", *words("--distance 0.3 --metric xy"))
    assert "certificate" not in done.out, "nothing was to be counted"
