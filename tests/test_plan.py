"""Spans and windows chosen from a budget of memory: what they are, what they promise, and that they keep to it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import streamseg as ss
from reference.consumer import ids_of
from reference.partition import same

# Some of the budgets tried are smaller than what reading takes.
pytestmark = [
    pytest.mark.filterwarnings("ignore:the densest place needs"),
    pytest.mark.filterwarnings("ignore:reading and writing take"),
]

# Beyond what the program itself takes every megabyte is room for a few thousand points.
SMALL_BUDGETS = st.integers(80_000_000, 84_000_000) | st.sampled_from([1, 100_000_000])

LINE = np.column_stack([np.arange(1000.0), np.zeros(1000), np.zeros(1000)])


def cluster(points: int, seed: int) -> NDArray[np.float64]:
    """Points on a lattice, hundreds of times as dense in one place as elsewhere, some far away."""
    random = np.random.default_rng(seed)
    places = random.normal(0.0, 4.0, (points, 3)) * random.choice([0.1, 1.0, 20.0], (points, 1))
    return np.round(places * [4.0, 1.0, 0.2], 2)


CLOUD = cluster(6_000, 1)
SEGMENTORS = [
    ss.Proximity(0.4),
    ss.Proximity(0.3, metric="xy"),
    ss.Proximity(0.4, graph="radius"),
    ss.Dbscan(0.5, min_points=4),
    ss.ConditionalClustering("angle < 20", search_radius=0.5),
    ss.RegionGrowing(k=8, search_radius=0.5),
]


@pytest.fixture(scope="module")
def static() -> dict[str, NDArray[np.int64]]:
    return {repr(segmentor): ss.segment_static(CLOUD, segmentor) for segmentor in SEGMENTORS}


@pytest.mark.parametrize("segmentor", SEGMENTORS, ids=lambda segmentor: type(segmentor).__name__)
@given(budget=SMALL_BUDGETS, swapped=st.booleans(), threads=st.integers(1, 3))
@settings(max_examples=8)
def test_the_partition_does_not_depend_on_the_budget(
    static: dict[str, NDArray[np.int64]], segmentor: Any, budget: int, swapped: bool, threads: int
) -> None:
    cloud = CLOUD[:, [1, 0, 2]] if swapped else CLOUD
    with ss.stream(cloud, segmentor, max_memory=budget, threads=threads, result="final") as run:
        assert run.is_identical
        labels = ids_of(run)
    assert same(labels, static[repr(segmentor)])


@pytest.mark.parametrize(
    ("name", "segmentor", "budget"),
    [
        ("tls/pines.laz", ss.Proximity(0.03, metric="xy"), "90MB"),
        ("mls/amsterdam_street.laz", ss.Dbscan(0.2), "95MB"),
    ],
)
def test_measured_clouds_in_short_windows_are_what_they_are_at_once(
    data: Path, name: str, segmentor: Any, budget: str
) -> None:
    chosen = ss.plan(data / name, segmentor, budget)
    assert chosen.windows > 10
    assert same(ss.segment(data / name, segmentor, spans=chosen), ss.segment_static(data / name, segmentor))


def test_ids_do_not_depend_on_the_threads() -> None:
    def raw(threads: int | None) -> list[list[int]]:
        run = ss.stream(CLOUD, SEGMENTORS[0], max_memory="81MB", threads=threads, result="history")
        return [span.segment_ids.tolist() for span in run]

    assert raw(1) == raw(2) == raw(None)


def test_a_plan_says_what_it_chose_and_can_be_used_again() -> None:
    chosen = ss.plan(LINE, ss.Proximity(1.5), "256MB")
    assert (chosen.direction, chosen.windows, chosen.most_points, chosen.warning) == ("x", 1, 1000, None)
    assert chosen.width == pytest.approx(1.5, rel=1e-5)
    assert re.fullmatch(
        r"Plan\(width=1.5\d+, direction='x', points_per_span=\d+, points_per_window=\d+, at_a_time=\d\)", repr(chosen)
    )
    labels = ss.segment(LINE, ss.Proximity(1.5), spans=chosen)
    assert np.array_equal(labels, np.ones(1000))
    # Across the cloud's shorter side more points would have to be in memory together.
    assert ss.plan(LINE[:, [1, 0, 2]], ss.Proximity(1.5)).direction == "y"


def test_lists_of_arrays_can_be_planned_and_generators_cannot() -> None:
    arrays = np.array_split(LINE[::-1], 7)
    assert np.array_equal(ss.segment(arrays, ss.Proximity(1.5), spans="auto"), np.ones(1000))
    with pytest.raises(ss.InvalidParameter, match=r"^spans is 'auto' for a live source, allowed: for files"):
        ss.stream(iter(arrays), ss.Proximity(1.5), spans="auto")


def test_what_memory_cannot_hold_is_told_in_one_sentence() -> None:
    dense = np.zeros((50_000, 3))
    with pytest.warns(ss.StreamsegWarning) as caught:
        labels = ss.segment(dense, ss.Proximity(1.0), max_memory="82MB")
    (warning,) = caught
    needed = re.fullmatch(
        r"the densest place needs windows of 50,000 points and a budget of about (\d+) MB, some of it in reserve, more than the max_memory of 82 MB; "
        "give at least that, or a smaller distance",
        str(warning.message),
    )
    assert needed is not None
    assert warning.filename == __file__
    assert np.array_equal(labels, np.ones(len(dense)))
    assert ss.plan(LINE, ss.Proximity(1.0), "82MB").warning == (
        "reading and writing take about 135 MB, more than the max_memory of 82 MB; give at least that"
    )
    assert ss.plan(dense, ss.Proximity(1.0), f"{needed[1]}MB").warning is None


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"max_memory": "lots"}, "max_memory is 'lots', allowed: a number of bytes above 0, or one with a unit"),
        ({"max_memory": 0}, "max_memory is 0, allowed: a number of bytes above 0"),
        ({"max_memory": -5}, "max_memory is -5, allowed: a number of bytes above 0"),
        ({"max_memory": 1.5}, "max_memory is 1.5, allowed: a number of bytes above 0"),
        (
            {"max_memory": "1GB", "spans": ss.SpanByWidth(2.0)},
            "max_memory is '1GB' with SpanByWidth(2.0, direction='x'), allowed: with spans='auto' or no spans",
        ),
        (
            {"spans": "auto", "window": ss.Window(3, 1)},
            "window is Window(spans=3, overlap=1) with a plan, allowed: none; the plan says how large windows are",
        ),
        ({"spans": "wide"}, "spans is 'wide', allowed: 'auto', SpanByWidth, SpanByCount, SpanByTime, SpanByScanLine"),
    ],
)
def test_what_does_not_go_together_is_told(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ss.InvalidParameter, match=f"^{re.escape(sentence)}"):
        ss.segment(LINE, ss.Proximity(1.5), **options)


def test_invalid_points_are_refused_or_dropped() -> None:
    broken = np.vstack([LINE[:10], [[np.nan, 0, 0]], LINE[10:]])
    with pytest.raises(ss.InvalidInput, match="point 10 has the coordinates"):
        ss.segment(broken, ss.Proximity(1.5), spans="auto")
    assert ss.segment(broken, ss.Proximity(1.5), spans="auto", drop_invalid=True)[10] == -1


def streamseg(*words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "COLUMNS": "400", "NO_COLOR": "1"}
    command = [sys.executable, "-m", "streamseg", *map(str, words)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, env=environment)


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    np.save(tmp_path / "line.npy", LINE)
    return partial(streamseg, cwd=tmp_path)


PLAN_IN_WORDS = r"""segmentor    Dbscan\(1.5, min_points=5, metric='xyz'\)
points       [\d,]+ in [\d,]+ slabs, each [\d.]+ wide
reach        pairs of points within 1.5 have to share a window, so windows overlap by one slab or more
halo         3 on either side of a window, loaded to be looked at
direction    along x, where the smallest window loads [\d,]+ points at the densest place; along y it would be [\d,]+
memory       256 MB at most: about \d+ MB for the program, the rest for windows; per point \d+ bytes .* at work, \d+ .*
room         [\d,]+ points a window, with up to \d windows at a time
windows      [\d,]+ of up to [\d,]+ points; each point is loaded [\d.]+ times on average
densest      [\d,]+ spans? over a length of [\d.]+: [\d,]+ points
thinnest     [\d,]+ spans? over a length of [\d.]+: [\d,]+ points
expected     a peak of about [\d,]+ MB with 1 window at a time
"""


def test_info_explains_the_plan(run: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    told = run(
        *["info", "line.npy", "--plan", "--method", "dbscan", "--eps", 1.5],
        *["--max-memory", "256MB", "--threads", 2],
    )
    assert told.returncode == 0, told.stderr
    assert re.fullmatch(PLAN_IN_WORDS, told.stdout), told.stdout


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["info", "line.npy", "--distance", 1], "--distance 1 is given without --plan, allowed: FILE only"),
        (["info", "line.npy", "--plan"], "--method proximity needs --distance"),
        (["info", "line.npy", "--plan", "--distance", 1, "--spans", 3], "streamseg: --spans is given with --plan"),
        (
            ["info", "line.npy", "--plan", "--distance", 1, "--span-width", 3],
            "streamseg: --span-width is given with --plan",
        ),
        (["info", "line.npy", "--plan", "--distance", 1, "--wide"], "No such option: --wide"),
        (
            ["segment", "line.npy", "o.npy", "--distance", 1, "--span-width", "wide"],
            "allowed: a number above 0, or auto",
        ),
        (
            ["segment", "line.npy", "o.npy", "--distance", 1, "--span-width", "auto", "--direction", "y"],
            "streamseg: --direction is given with --span-width auto",
        ),
        (
            ["segment", "line.npy", "o.npy", "--distance", 1, "--max-memory", "1GB", "--spans", 4],
            "streamseg: --spans is given with --max-memory, which chooses it; leave it out",
        ),
    ],
)
def test_wrong_words_are_told(
    run: Callable[..., subprocess.CompletedProcess[str]], words: list[object], sentence: str
) -> None:
    told = run(*words)
    assert told.returncode == 2
    assert sentence in told.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="only here the kernel counts resident pages in this way")
@pytest.mark.parametrize("options", [["--distance", 0.05], ["--method", "growing", "--k", 30, "--search-radius", 0.05]])
def test_the_peak_of_the_process_stays_below_the_budget(data: Path, options: list[object], tmp_path: Path) -> None:
    words = ["segment", data / "tls" / "pines.laz", "out.laz", *options, "--max-memory", "160MB", "--threads", 2]
    command = [sys.executable, "-m", "streamseg", *map(str, words)]
    # The kernel's peak of a child starts at what its parent holds, so the parent has to be a small one.
    launcher = [
        "import resource, subprocess, sys",
        "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)",
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)",
    ]
    told = subprocess.run(
        [sys.executable, "-c", "\n".join(launcher), *command], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert 50e6 < int(told.stdout) * 1024 < 160e6
