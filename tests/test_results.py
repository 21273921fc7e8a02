"""Three kinds of result and a history, which all tell the same story."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from numpy.typing import NDArray

import streamseg as ss
from reference import history
from reference.clouds import LatticeCloud
from reference.consumer import Follower, in_order
from reference.partition import same
from reference.scripts import Script, scripts

Ids = NDArray[np.int64]

# Distances at which each cloud falls into many segments, and widths that cut it into many windows.
CLOUDS = {
    "als/autzen_trim.laz": (6.0, 12.0),
    "als/bcts_2.laz": (0.7, 2.0),
    "als/bcts_3.laz": (0.7, 2.0),
    "als/chablais3.laz": (0.8, 1.0),
    "als/delft_ahn3.laz": (0.6, 2.0),
    "als/hawaii_pass.laz": (1.3, 8.0),
    "als/lidarhd_77050_627755.laz": (0.4, 0.5),
    "als/lidarhd_77050_627760.laz": (0.3, 0.5),
    "als/lidarhd_77055_627755.laz": (0.3, 0.5),
    "als/lidarhd_77055_627760.laz": (0.3, 0.5),
    "als/megaplot.laz": (1.6, 6.0),
    "als/mixed_conifer.laz": (2.0, 2.0),
    "als/topography.laz": (1.8, 3.0),
    "als/williams_town.laz": (0.8, 3.0),
    "isprs/CSite2.laz": (2.0, 4.0),
    "isprs/CSite3.laz": (2.0, 4.0),
    "isprs/FSite5.laz": (3.0, 12.0),
    "mls/amsterdam_street.laz": (0.1, 0.4),
    "tls/lone_star.laz": (0.08, 0.3),
    "tls/pines.laz": (0.08, 0.2),
}


def resolved(folder: Path) -> Ids:
    parts = list(ss.History(folder).resolve())
    return in_order([points for points, _ in parts], [ids for _, ids in parts])


def assert_history_and_carry_agree(
    source: object, segmentor: object, folder: Path, **options: Any
) -> tuple[Ids, Follower]:
    with ss.stream(source, segmentor, history=folder, **options) as run:
        consumer = Follower(run)
    raw = history.raw_ids(folder)
    final = history.final_ids(folder)
    assert np.array_equal(resolved(folder), final), "resolve of the history"
    assert np.array_equal(run.resolve(raw), final), "resolve of raw ids"
    carried = in_order(consumer.point_ids, consumer.carried)
    assert np.array_equal(run.resolve(carried), final), "resolve of carried ids"
    assert np.array_equal(run.resolve(final), final), "resolve of final ids"
    assert np.array_equal(consumer.final(), final), "carried ids after their aliases"
    assert np.all((final <= carried) & (carried <= raw)), "ids only become smaller"
    return final, consumer


def assert_all_results_agree(source: object, segmentor: object, folder: Path, **options: Any) -> tuple[Ids, Follower]:
    final, consumer = assert_history_and_carry_agree(source, segmentor, folder, **options)
    with ss.stream(source, segmentor, result="final", **options) as run:
        spans = list(run)
    settled = in_order([span.point_ids for span in spans], [span.segment_ids for span in spans])
    assert np.array_equal(settled, final), "final ids"
    assert not any(len(span.aliases) for span in spans)
    return final, consumer


@given(scripts)
@example(Script([2, 2, 2, 2], ss.Window(2, 1), [0, 1, 0, 1, 2, 0, 0, 0, 0, 1, 0]))
def test_results_agree_on_anything_a_segmentor_says(script: Script) -> None:
    with TemporaryDirectory() as folder:
        source, segmentor = script.spans(), script.segmentor()
        final, _ = assert_all_results_agree(source, segmentor, Path(folder, "run"), window=script.window)
    assert np.array_equal(ss.segment(source, segmentor, window=script.window), final)


@pytest.mark.parametrize("name", CLOUDS)
def test_results_agree_on_measured_clouds(cloud: Callable[[str], LatticeCloud], tmp_path: Path, name: str) -> None:
    path, points, _ = cloud(name)
    distance, width = CLOUDS[name]
    segmentor, spans = ss.Proximity(distance), ss.SpanByWidth(width)
    check = assert_all_results_agree if len(points) < 500_000 else assert_history_and_carry_agree
    final, consumer = check(path, segmentor, tmp_path / "run", spans=spans)
    print(f"{name}: {len(np.unique(final))} segments, {consumer.aliases} aliases, {len(consumer.carried)} spans")
    assert len(final) == len(points)
    assert final.min() >= 1
    if len(points) < 100_000:
        assert np.array_equal(ss.segment(path, segmentor, spans=spans), final)


def test_every_cloud_there_is_takes_part(data: Path) -> None:
    # Other layouts of the same clouds are read in the tests of files.
    found = {path.relative_to(data).as_posix() for path in data.rglob("*.laz")}
    assert {name for name in found if not name.startswith(("formats/", "odd/"))} == set(CLOUDS)


def u_shapes(count: int, depth: int) -> NDArray[np.float64]:
    """Nested U on their sides, all open towards the start of the stream and closed at its end."""
    arms = [np.column_stack([np.arange(depth), np.full(depth, 10 * y)]) for y in range(2 * count)]
    bottoms = []
    for u in range(count):
        low, high = 10 * u, 10 * (2 * count - 1 - u)
        x = depth + 10 * (count - 1 - u)
        tips = np.arange(depth, x + 1)
        bottoms += [np.column_stack([tips, np.full(len(tips), y)]) for y in (low, high)]
        ys = np.arange(low, high + 1)
        bottoms.append(np.column_stack([np.full(len(ys), x), ys]))
    flat = np.unique(np.concatenate(arms + bottoms), axis=0)
    return np.column_stack([flat, np.zeros(len(flat))]).astype(float)


def test_arms_of_a_u_meet_after_both_have_gone_out(tmp_path: Path) -> None:
    points = u_shapes(5, 200)
    spans = ss.SpanByWidth(5.0)
    final, consumer = assert_all_results_agree(points, ss.Proximity(1.0), tmp_path / "run", spans=spans)
    assert np.unique(final).tolist() == [1, 2, 3, 4, 5]
    assert consumer.aliases == 5
    assert np.unique(consumer.carried[0]).tolist() == list(range(1, 11))
    assert same(final, ss.segment_static(points, ss.Proximity(1.0)))


def test_a_comb_of_arms_becomes_one_in_a_chain_of_aliases(tmp_path: Path) -> None:
    # Forty teeth; the last meet first, so that every alias is of an id that has become others before.
    teeth = [np.column_stack([np.arange(300 - 5 * k), np.full(300 - 5 * k, 10 * k)]) for k in range(40)]
    steps = [np.column_stack([np.full(11, 299 - 5 * k), 10 * (k - 1) + np.arange(11)]) for k in range(1, 40)]
    flat = np.unique(np.concatenate(teeth + steps), axis=0)
    points = np.column_stack([flat, np.zeros(len(flat))]).astype(float)
    final, consumer = assert_all_results_agree(
        points, ss.Proximity(1.0), tmp_path / "run", spans=ss.SpanByWidth(4.0), window=ss.Window(4, 2)
    )
    assert np.unique(final).tolist() == [1]
    assert consumer.aliases == 39


def test_the_history_of_carried_ids_keeps_the_aliases(tmp_path: Path) -> None:
    told = []
    with ss.stream(u_shapes(3, 60), ss.Proximity(1.0), spans=ss.SpanByWidth(5.0), history=tmp_path / "run") as run:
        for span in run:
            told += [[*alias, span.index] for alias in span.aliases.tolist()]
    assert len(told) == 3
    assert history.table(tmp_path / "run", "alias").tolist() == sorted(told)


def test_history_spans_have_raw_ids_and_no_aliases(tmp_path: Path) -> None:
    options: dict[str, Any] = {"spans": ss.SpanByWidth(5.0), "history": tmp_path / "run", "result": "history"}
    with ss.stream(u_shapes(3, 60), ss.Proximity(1.0), **options) as run:
        spans = list(run)
    assert all(span.aliases.shape == (0, 2) for span in spans)
    raw = in_order([span.point_ids for span in spans], [span.segment_ids for span in spans])
    assert np.array_equal(raw, history.raw_ids(tmp_path / "run"))
    assert len(history.table(tmp_path / "run", "alias")) == 0


def test_spans_hold_the_points_of_their_ids(data: Path) -> None:
    cloud = ss.io.open_cloud(data / "als" / "mixed_conifer.laz")
    points = np.concatenate([cloud.lattice.to_coordinates(chunk.points) for chunk in cloud.chunks()])
    for result in ("carry", "final", "history"):
        for index, span in enumerate(ss.stream(cloud, ss.Proximity(1.0), spans=ss.SpanByWidth(9.0), result=result)):
            assert span.index == index
            assert len(span) == len(span.point_ids) == len(span.segment_ids)
            assert np.all(np.diff(span.point_ids) > 0)
            assert np.array_equal(span.points, points[span.point_ids])


def test_final_spans_can_do_without_their_points(data: Path) -> None:
    path = data / "als" / "mixed_conifer.laz"
    with ss.stream(path, ss.Proximity(1.0), spans=ss.SpanByWidth(9.0), result="final", with_points=False) as run:
        spans = list(run)
    assert sum(len(span) for span in spans) == 37_657
    assert all(span.points.shape == (0, 3) for span in spans)


def test_to_csv_equals_the_parquet(tmp_path: Path) -> None:
    list(ss.stream(u_shapes(3, 60), ss.Proximity(1.0), spans=ss.SpanByWidth(5.0), history=tmp_path / "run"))
    past = ss.History(tmp_path / "run")
    files = past.to_csv(tmp_path / "csv")
    assert [file.stem for file in files] == list(history.COLUMNS)
    for file in files:
        with file.open(newline="") as lines:
            header, *rows = csv.reader(lines)
        assert tuple(header) == history.COLUMNS[file.stem]
        assert sorted([int(value) for value in row] for row in rows) == history.table(past.folder, file.stem).tolist()
    with pytest.raises(ss.OutputExists, match=r"point_segment\.csv exists"):
        past.to_csv(tmp_path / "csv")
    assert past.to_csv(tmp_path / "csv", overwrite=True) == files
