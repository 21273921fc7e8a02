"""Every method and every option of `streamseg segment`, on a small file: what it does, and what is refused."""

from __future__ import annotations

import inspect
import re
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
    assert f"{len(labels):,} points in {found:,} segments" in done.out


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
    assert "smaller than 20 points left out" in done.out
    done = run("segment", village, "two.las", "--method", "dbscan", "--eps", 0.8, "--seed-filter", "false")
    assert "in 0 segments" in done.out
    assert "without a seed left out" in done.out
    assert np.all(ids(Path("two.las")) == -1)


def test_an_order_by_size_needs_final_ids(run: Run, village: Path) -> None:
    done = run("segment", village, "out.las", "--distance", 1, "--sort", "ascending", "--result", "carry")
    assert done.status == 2
    assert "sort is 'ascending' with result='carry', allowed: with result='final'" in done.err


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
        ["--method is 'hdbscan2', allowed: proximity, dbscan, conditional, planes"],
    ),
    "proximity needs": ("--method proximity", ["--method proximity needs --distance"]),
    "dbscan needs": ("--method dbscan --min-points 4", ["--method dbscan needs --eps"]),
    "of another method": (
        "--method dbscan --eps 1 --distance 2",
        ["--distance is given with --method dbscan, allowed there: --eps, --min-points, --metric"],
    ),
    "growing has no criterion": (
        "--method growing --criterion true",
        ["--criterion is given with --method growing, allowed there: --k"],
    ),
    "planes are not literal": ("--method planes --literal", ["--literal is given with --method planes"]),
    "conditional has no k": ("--method conditional --k 8", ["--k is given with --method conditional"]),
    "proximity has no radius": ("--distance 1 --search-radius 2", ["--search-radius is given with --method proximity"]),
    "set with ours": ("--distance 1 --set eps=1", ["--set eps=1 is given with --method proximity, allowed: with"]),
    "radius": ("--method conditional --search-radius wide", ["--search-radius is 'wide', allowed: a number"]),
    "radii": (
        "--method conditional --search-radius 1,2,3,4 --search-mode 2.5d",
        ["--search-radius is (1.0, 2.0, 3.0, 4.0), allowed: "],
    ),
    "radius below 0": (
        "--method planes --search-radius -1",
        ["--search-radius is -1, allowed: a finite number above 0"],
    ),
    "mode": ("--method conditional --search-mode 3", ["--search-mode is '3', allowed: '2d', '2.5d' or '3d'"]),
    "criterion": (
        "--method conditional --criterion 'abs(Z-n[0].Z)<'",
        ["criterion, column 15: ", "abs(Z-n[0].Z)<"],
    ),
    "no such attribute": (
        "--method conditional --criterion 'Amplitude == n[0].Amplitude'",
        ["criterion, column 1: there is no attribute 'Amplitude'", "there are: X, Y, Z", "Pulse width"],
    ),
    "filter": ("--distance 1 --filter 'Z > '", ["filter, column"]),
    "no neighborhood": ("--distance 1 --filter 'NormalZ > 0'", ["NormalZ is no attribute of the cloud"]),
    "calculator": ("--method planes --seed-calculator 'Z > 1'", ["calculator, column 1: ", "true or false"]),
    "angle": ("--method growing --angle 120", ["--angle is 120, allowed: "]),
    "planes' angle": ("--method planes --angle -4", ["--angle is -4, allowed: "]),
    "curvature": ("--method growing --curvature gauss", ["curvature is 'gauss', allowed: "]),
    "size": ("--distance 1 --min-size 0", ["--min-size is 0, allowed: "]),
    "sizes": ("--distance 1 --min-size 9 --max-size 3", ["--max-size is 3 with a --min-size of 9"]),
    "sort": ("--distance 1 --sort random", ["sort is 'random', allowed: 'native', 'ascending' or 'descending'"]),
    "normals": ("--distance 1 --normals fmcd", ["normals is 'fmcd', allowed: 'least_squares' or 'robust'"]),
    "outliers": ("--distance 1 --outliers many", ["--outliers has 'many' where a whole number is needed"]),
    "outliers' k": ("--distance 1 --outliers 0", ["k is 0, allowed: "]),
    "half a neighbor": ("--distance 1 --outliers 6.5", ["--outliers has '6.5' where a whole number is needed"]),
    "endless neighbors": ("--distance 1 --outliers inf", ["--outliers has 'inf' where a whole number is needed"]),
    "outliers' dialect": ("--distance 1 --outliers 8,2,cgal", ["--outliers is 'cgal', allowed: "]),
    "too much of outliers": ("--distance 1 --outliers 8,2,pcl,3", ["--outliers is '8,2,pcl,3', allowed: "]),
    "lonely": ("--distance 1 --lonely -2,3", ["--lonely is -2, allowed: "]),
    "too much of lonely": ("--distance 1 --lonely 1,2,3", ["--lonely is '1,2,3', allowed: "]),
    "voxel": ("--distance 1 --voxel 0", ["--voxel is 0, allowed: "]),
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
    assert done.out == f"{expected}\n"
    assert done.status == (0 if expected.is_identical else 3)


def test_verify_has_the_options_of_segment_and_uses_each() -> None:
    options = set(inspect.signature(verify).parameters)
    output = {"output", "result", "history", "preview", "overwrite"}
    assert options == set(inspect.signature(segment).parameters) - output
    used = {"inputs", "method", "settings", "outliers", "lonely", "voxel", "spans", "overlap", "quiet"}
    used |= {name.removeprefix("--").replace("-", "_") for method in METHODS.values() for name in method.options}
    used |= {name.removeprefix("--").replace("-", "_") for name in OPTIONS}
    used |= {"span_width", "direction", "span_count", "span_time", "span_lines"}
    used |= {"max_memory", "threads", "drop_invalid", "revisit"}
    assert options <= used, "cli/verify.py has to hand these on too"


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
        ("--distance 1 --span-width 0", "width is 0"),
        ("--distance 1 --history past", "--history"),
    ]:
        done = run("verify", village, *words(text))
        assert done.status == 2
        assert sentence in done.err
    assert run("verify", "no.laz", *words("--distance 1")).status == 2


def test_segment_tells_what_it_could_prove(run: Run, village: Path) -> None:
    done = run("segment", village, "out.las", *words("--method growing --search-radius 2 --span-width 5"))
    assert done.status == 0
    assert re.search(r"^certificate: 0 of [\d,]+ points undecided; equal to the static result, proven$", done.out, re.M)
    done = run("segment", village, "other.las", *words("--distance 0.3 --metric xy"))
    assert "certificate" not in done.out, "nothing was to be counted"
