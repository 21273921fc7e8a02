"""What the command line says of a run: every point is accounted for, and a remedy is named where most are lost."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import streamseg as ss
from streamseg.cli import main

Say = Callable[..., list[str]]

# Stacks of 1, 2 … 6 points that are far apart, lower ones first: 21 points.
STACKS = np.column_stack([np.repeat(np.arange(6.0), np.arange(1, 7)) * 10, np.zeros((21, 2))])
STACKS[:, 2] = STACKS[:, 0] / 10


@pytest.fixture
def say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Say:
    """Run the command line; the lines that it says, without the promise."""
    monkeypatch.chdir(tmp_path)
    np.save("in.npy", STACKS)

    def say(*words: object) -> list[str]:
        monkeypatch.setattr(sys, "argv", ["streamseg", *map(str, words), "--overwrite"])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.StreamsegWarning)
            with pytest.raises(SystemExit) as ended:
                main()
        told = capsys.readouterr()
        assert ended.value.code in (0, None), told.err
        lines = [
            line.partition(";")[0] if " windows;" in line or " window;" in line else line
            for line in told.out.splitlines()
        ]
        return [line for line in lines if not line.startswith(("certificate", "history"))]

    return say


def test_a_run_in_which_every_point_has_a_segment(say: Say) -> None:
    assert say("segment", "in.npy", "out.npy", "--distance", 1) == ["out.npy: 21 points in 6 segments, 1 window"]
    np.save("in.npy", STACKS[:1])
    assert say("segment", "in.npy", "out.npy", "--distance", 1) == ["out.npy: 1 point in 1 segment, 1 window"]


def test_the_points_without_a_segment_are_told_by_cause(say: Say) -> None:
    told = say("segment", "in.npy", "out.npy", "--distance", 1, "--min-size", 2, "--max-size", 5, "--filter", "Z < 5")
    assert told[0].startswith("out.npy: 14 of 21 points in 4 segments, ")
    assert told[1:] == ["7 points have no segment (33 %): 6 left out by --filter, 1 in 1 segment smaller than 2 points"]


@pytest.mark.parametrize(
    ("options", "sentences"),
    [
        (
            ("--distance", 1, "--min-size", 5, "--max-size", 5),
            [
                "16 points have no segment (76 %): 10 in 4 segments smaller than 5 points, "
                "6 in 1 segment larger than 5 points",
                "more points would be in one with a smaller --min-size (5), or a larger --distance (1)",
            ],
        ),
        (
            ("--method", "dbscan", "--eps", 1, "--min-points", 6),
            [
                "15 points have no segment (71 %): all noise",
                "more points would be in one with a larger --eps (1), or a smaller --min-points (6)",
            ],
        ),
        (
            ("--distance", 1, "--filter", "Z == 3"),
            [
                "17 points have no segment (81 %): all left out by --filter",
                "more points would be in one with another --filter",
            ],
        ),
        (
            ("--distance", 1, "--lonely", "1,4"),
            ["10 points have no segment (48 %): all removed by --lonely"],
        ),
        (
            ("--distance", 1, "--lonely", "1,5"),
            [
                "15 points have no segment (71 %): all removed by --lonely",
                "more points would be in one with a milder --lonely",
            ],
        ),
    ],
    ids=str,
)
def test_where_most_points_are_lost_a_remedy_is_named(
    say: Say, options: tuple[object, ...], sentences: list[str]
) -> None:
    assert say("segment", "in.npy", "out.npy", *options)[1:] == sentences


@pytest.mark.parametrize(
    ("options", "sentences"),
    [
        (
            ("--distance", 1, "--filter", "Z < 2", "--min-size", 100),
            [
                'no segment: --filter "Z < 2" leaves 3 of 21 points, and all of these are in 2 segments '
                "smaller than 100 points",
                "more points would be in one with another --filter; or with a smaller --min-size (100), or a larger "
                "--distance (1)",
            ],
        ),
        (
            ("--distance", 1, "--filter", "Z < 0"),
            [
                'no segment: --filter "Z < 0" leaves none of 21 points',
                "more points would be in one with another --filter",
            ],
        ),
        (
            ("--distance", 1, "--lonely", "1,2", "--filter", "Z < 3", "--min-size", 4, "--max-size", 4),
            [
                'no segment: --lonely leaves 18 of 21 points, --filter "Z < 3" leaves 3 of 18 points, and all '
                "of these are in 1 segment smaller than 4 points",
                "more points would be in one with another --filter; or with a milder --lonely",
            ],
        ),
        (
            ("--distance", 1, "--seed-filter", "false"),
            [
                "no segment: all 21 points are without a seed",
                "more points would be in one with another --seed-filter",
            ],
        ),
        (
            ("--method", "growing", "--k", 1),
            [
                "no segment: with --k 1 a point has no neighbor but itself",
                "more points would be in one with a larger --max-curvature (0.05) or --angle (30), or another --k (1)",
            ],
        ),
    ],
    ids=str,
)
def test_a_run_without_any_segment_says_what_became_of_all_points(
    say: Say, options: tuple[object, ...], sentences: list[str]
) -> None:
    told = say("segment", "in.npy", "out.npy", *options)
    assert told[0].startswith("out.npy: 0 of 21 points in 0 segments, ")
    assert told[1:] == sentences


def test_shares_are_never_rounded_to_none_or_all(say: Say) -> None:
    np.save("in.npy", np.repeat([[0.0, 0, 0], [9, 0, 0]], [999, 1], axis=0))
    assert say("segment", "in.npy", "out.npy", "--distance", 1, "--min-size", 2)[1:] == [
        "1 point has no segment (less than 1 %): all in 1 segment smaller than 2 points"
    ]
    told = say("segment", "in.npy", "out.npy", "--distance", 1, "--max-size", 2)
    assert told[1] == "999 points have no segment (99 %): all in 1 segment larger than 2 points"


def test_carried_ids_know_no_sizes(say: Say) -> None:
    told = say(
        "segment", "in.npy", "out.npy", "--distance", 1, "--min-size", 4, "--filter", "Z > 0", "--result", "carry"
    )
    assert told[0].startswith("out.npy: 20 of 21 points in 5 segments as far as was known")
    assert told[1:] == ["1 point has no segment (5 %): all left out by --filter"]


def test_a_history_keeps_the_causes(say: Say) -> None:
    run = ("segment", "in.npy", "out.npy", "--distance", 1, "--min-size", 3, "--filter", "Z > 0", "--history", "past")
    say(*run)
    assert say("resolve", "past", "in.npy", "again.npy") == [
        "again.npy: 18 of 21 points in 4 segments, with final segment ids",
        "3 points have no segment (14 %): 2 in 1 segment smaller than 3 points, 1 left out by the filter",
    ]
    assert say("resolve", "past", "in.npy", "again.npy", "--no-limits") == [
        "again.npy: 20 of 21 points in 5 segments, with final segment ids",
        "1 point has no segment (5 %): 1 left out by the filter",
    ]


def test_a_history_without_causes_is_read_too(say: Say) -> None:
    say("segment", "in.npy", "out.npy", "--distance", 1, "--filter", "Z > 0", "--history", "past")
    manifest = Path("past", "manifest.json")
    before, _, after = manifest.read_text().partition('"unlabelled": {')
    manifest.write_text(before + after.partition("},")[2])
    assert say("resolve", "past", "in.npy", "again.npy")[1:] == [
        "1 point has no segment (5 %): 1 in no segment of any window"
    ]
