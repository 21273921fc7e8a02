"""Streamed compared with static: what is said of two partitions, of where they differ, and why."""

from __future__ import annotations

import inspect
import os
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

import streamseg as ss
from reference.partition import agreement, same
from reference.roster import houses
from streamseg.comparison import compare

Ids = NDArray[np.int64]

# Few and odd numbers, so that segments overlap in every way; -1 is none.
ids = st.lists(st.tuples(st.sampled_from([-1, 1, 2, 7, 2**40]), st.sampled_from([-1, 1, 3, 5])), max_size=30)


def columns(pairs: list[tuple[int, int]]) -> tuple[Ids, Ids]:
    both = np.array(pairs, np.int64).reshape(-1, 2)
    return both[:, 0], both[:, 1]


# Two partitions.


def naively_differing(pairs: list[tuple[int, int]]) -> list[int]:
    """Points that are not in the largest share of their segment on both sides; the lesser number wins a tie."""
    shares = Counter(pairs)

    def is_largest(pair: tuple[int, int], side: int) -> bool:
        rivals = [other for other in shares if other[side] == pair[side] and (other[0] == -1) == (other[1] == -1)]
        return pair == min(rivals, key=lambda other: (-shares[other], other), default=None)

    return [
        point
        for point, pair in enumerate(pairs)
        if (pair[0] == -1) != (pair[1] == -1) or not (is_largest(pair, 0) and is_largest(pair, 1))
    ]


@given(ids)
def test_points_that_differ_are_those_that_a_slow_twin_finds(pairs: list[tuple[int, int]]) -> None:
    static, streamed = columns(pairs)
    found = compare(static, streamed, most=100)
    assert found.differing.tolist() == naively_differing(pairs)
    assert (not len(found.differing)) == same(static, streamed)
    assert sum(difference.points for difference in found.differences) == len(found.differing)
    firsts = [difference.point_id for difference in found.differences]
    assert firsts == sorted(firsts)
    for point, *segments, count in found.differences:
        together = (static == segments[0]) & (streamed == segments[1])
        assert np.flatnonzero(together)[0] == point
        assert np.count_nonzero(together) == count


@given(ids)
def test_the_agreement_is_that_of_scikit_learn(pairs: list[tuple[int, int]]) -> None:
    static, streamed = columns(pairs)
    assert compare(static, streamed).adjusted_rand_index == pytest.approx(
        adjusted_rand_score(static, streamed), abs=1e-12
    )


def test_pairs_are_counted_beyond_what_a_float_or_an_integer_of_the_machine_holds() -> None:
    # Two segments of 2 million points, one point apart: 10¹² pairs, and products of them beyond 10²⁴.
    static = np.repeat([1, 2], 2_000_000)
    streamed = static.copy()
    streamed[7] = 3
    index = compare(static, streamed).adjusted_rand_index
    assert index == pytest.approx(adjusted_rand_score(static, streamed), abs=1e-12)
    # That one point parts 2 million of 4 · 10¹² pairs.
    assert 4e-7 < 1 - index < 6e-7


def test_numbers_do_not_matter_but_none_does() -> None:
    static = np.array([1, 1, 2, -1, -1])
    assert not len(compare(static, np.array([9, 9, 4, -1, -1])).differing)
    found = compare(static, np.array([1, 1, 2, 3, 3]))
    assert found.adjusted_rand_index == 1.0
    assert found.differing.tolist() == [3, 4]
    assert found.differences == ((3, -1, 3, 2),)
    assert compare(static, np.full(5, -1)).differing.tolist() == [0, 1, 2]


def test_the_larger_part_of_a_torn_segment_is_the_same_one() -> None:
    found = compare(np.array([1, 1, 1, 1, 1, 2]), np.array([4, 4, 5, 5, 5, 6]), most=1)
    assert found.differing.tolist() == [0, 1]
    assert found.differences == ((0, 1, 4, 2),)


# Two runs.

CLOUD = houses(40)
FAR = ss.Proximity(0.3, metric="xy")


def whole(window: ss.WindowPoints) -> Ids:
    """Label all of a window alike where it has an even number of points: as unlike the static result as can be."""
    return np.full(len(window), -1 if len(window) % 2 else 0)


def test_what_is_identical_is_told_so() -> None:
    found = ss.verify(CLOUD, FAR, spans=ss.SpanByWidth(2.0))
    expected = ss.segment_static(CLOUD, FAR)
    assert (found.is_identical, found.is_proven, found.adjusted_rand_index) == (True, True, 1.0)
    assert found.points == len(CLOUD)
    assert found.static_segments == found.streamed_segments == len(np.unique(expected))
    assert (len(found.differing), found.differences, found.reasons) == (0, (), ())
    assert str(found).splitlines() == [
        f"identical: 1,500 points in {found.static_segments:,} segments, streamed and static",
        "certificate: nothing to count; equal to the static result, proven",
    ]


def test_what_the_run_counted_is_told() -> None:
    growing = ss.RegionGrowing(16, search_radius=1.5, angle_deg=20.0)
    found = ss.verify(CLOUD, growing, spans=ss.SpanByWidth(4.0))
    assert found.is_identical
    assert found.is_proven
    assert found.certificate.decided_points >= len(CLOUD)
    assert f"0 points undecided in {found.certificate.decided_points:,} decisions; equal to the static" in str(found)


def differing() -> ss.Verification:
    with pytest.warns(ss.StreamsegWarning, match="overlap by 0.1, less than the distance 0.3"):
        return ss.verify(CLOUD, FAR, spans=ss.SpanByWidth(0.1), window=ss.Window(2, 1))


def test_what_differs_is_told_with_where_and_why() -> None:
    found = differing()
    with pytest.warns(ss.StreamsegWarning):
        streamed = ss.segment(CLOUD, FAR, spans=ss.SpanByWidth(0.1), window=ss.Window(2, 1))
    static = ss.segment_static(CLOUD, FAR)
    assert not found.is_identical
    assert not found.is_proven
    assert found.adjusted_rand_index == pytest.approx(agreement(static, streamed))
    assert (found.static_segments, found.streamed_segments) == (len(np.unique(static)), len(np.unique(streamed)))
    assert found.differing.tolist() == compare(static, streamed).differing.tolist()
    assert len(found.differences) == 5
    for difference, position in zip(found.differences, found.positions, strict=True):
        assert difference.static_segment == static[difference.point_id]
        assert difference.streamed_segment == streamed[difference.point_id]
        np.testing.assert_array_equal(position, CLOUD[difference.point_id])
    assert found.reasons == (
        "windows overlap by 0.1, less than the distance 0.3: the result may differ from the static one; "
        "use wider spans or more overlap",
    )
    told = str(found)
    assert told.startswith(
        f"not identical: {found.streamed_segments:,} segments streamed, {found.static_segments:,} static; "
    )
    assert f"{len(found.differing):,} of 1,500 points differ" in told
    assert f"  1. {found.reasons[0]}" in told
    assert f"{found.differences[0].point_id:>14}" in told


def test_positions_of_a_file_are_in_its_units(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = np.full(3, 0.125), np.array([1000.0, -500.0, 3.0])
    las = laspy.LasData(header)
    las.xyz = CLOUD + np.array([1000.0, -500.0, 3.0])
    las.write(tmp_path / "houses.las")
    found = ss.verify(tmp_path / "houses.las", ss.Proximity(1.0), spans=ss.SpanByCount(100))
    assert found.differences
    points = [difference.point_id for difference in found.differences]
    np.testing.assert_array_equal(found.positions, las.xyz[points])


def first_reason(segmentor: Any, **more: Any) -> str:
    found = ss.verify(CLOUD, segmentor, **more)
    assert not found.is_identical
    return found.reasons[0]


def test_why_tells_apart_what_can_be_the_matter() -> None:
    by_count = ss.SpanByCount(100)
    assert first_reason(FAR, spans=by_count).startswith("the spans are in stream order, so points in reach")
    assert first_reason(ss.Proximity(1.0), spans=by_count).startswith("the spans are in stream order and do not say")
    assert first_reason(whole, spans=ss.SpanByWidth(5.0)).startswith("the method makes no promise")
    running = ss.StatisticalOutlierRemoval(8, statistics="running")
    found = ss.verify(CLOUD, FAR, spans=ss.SpanByWidth(1.0), preprocess=running)
    assert not found.is_identical
    assert found.reasons[0].startswith("StatisticalOutlierRemoval(")
    assert "depends on the spans" in found.reasons[0]


def test_what_should_be_identical_and_is_not_is_called_a_defect(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("streamseg.verification.segment_static", lambda *_, **__: np.ones(len(CLOUD), np.int64))
    found = ss.verify(CLOUD, FAR, spans=ss.SpanByWidth(2.0))
    assert not found.is_identical
    assert len(found.reasons) == 1
    assert "defect of streamseg" in found.reasons[0]


def test_doubts_are_told_with_their_number() -> None:
    none = ss.Certificate(*[0] * len(ss.Certificate._fields))
    assert (str(none), none.doubts) == ("nothing to count", ())
    certificate = none._replace(
        decided_edges=10,
        undecided_edges=2,
        decided_points=30,
        undecided_points=1,
        returned_points=4,
        waited_points=5,
        most_waiting=3,
        early_decisions=6,
    )
    assert not certificate.is_complete
    assert [doubt.split(" could")[0].split(" went")[0].split(" were")[0] for doubt in certificate.doubts] == [
        "2 edges",
        "1 points",
        "6 decisions about points",
    ]
    assert str(certificate) == (
        "2 edges undecided in 12 decisions, 1 points undecided in 31 decisions, 4 points returned, "
        "5 points waited, 3 at a time, 6 early decisions"
    )
    complete = none._replace(decided_edges=1_234_567)
    assert (str(complete), complete.doubts) == ("0 edges undecided in 1,234,567 decisions", ())


def test_a_run_is_proven_only_when_it_has_ended() -> None:
    with ss.stream(CLOUD, FAR, spans=ss.SpanByWidth(2.0)) as run:
        next(run)
        assert run.is_identical
        assert not run.is_proven
        for _ in run:
            pass
    assert run.is_proven
    with ss.stream(CLOUD, FAR, spans=ss.SpanByCount(100)) as run:
        for _ in run:
            pass
    assert not run.is_identical
    assert not run.is_proven


# What it takes.


def test_sources_that_can_be_read_twice(tmp_path: Path) -> None:
    np.save(tmp_path / "houses.npy", CLOUD)
    holed = np.vstack([CLOUD, np.full((1, 3), np.nan)])
    spans = ss.SpanByWidth(2.0)
    for source, more in [
        (tmp_path / "houses.npy", {}),
        ([CLOUD[:700], CLOUD[700:]], {}),
        (holed, {"drop_invalid": True}),
        (CLOUD, {"threads": 2, "preprocess": ss.VoxelGrid(0.25)}),
    ]:
        assert ss.verify(source, FAR, spans=spans, **more).is_identical  # type: ignore[arg-type]
    bright = ss.ConditionalClustering("Intensity == n[0].Intensity", search_radius=0.5, min_segment_size=1)
    intensity = {"Intensity": np.arange(len(CLOUD)) % 3}
    assert ss.verify(CLOUD, bright, spans=spans, attributes=intensity).is_identical
    assert ss.verify(np.zeros((0, 3)), FAR).is_identical


def test_it_takes_all_that_segment_takes() -> None:
    taken = inspect.signature(ss.verify).parameters
    for name, parameter in inspect.signature(ss.segment).parameters.items():
        assert name in taken
        assert taken[name].default == parameter.default


def test_of_a_damaged_file_what_comes_before_is_compared(tmp_path: Path) -> None:
    las = laspy.create(point_format=1, file_version="1.2")
    las.header.scales = np.full(3, 0.125)
    las.xyz = np.tile(CLOUD, (40, 1))
    las.write(tmp_path / "whole.laz")
    (tmp_path / "cut.laz").write_bytes((tmp_path / "whole.laz").read_bytes()[:-60_000])
    with pytest.warns(ss.StreamsegWarning, match="damaged") as caught:
        found = ss.verify(tmp_path / "cut.laz", FAR, spans=ss.SpanByWidth(5.0))
    assert len(caught) == 1
    assert found.damage is not None
    assert "damaged" in found.damage
    assert 1_500 < found.points < 60_000
    assert found.is_identical


def test_what_can_be_read_only_once_is_refused() -> None:
    live = (CLOUD[start : start + 100] for start in range(0, 1500, 100))
    with pytest.raises(ss.InvalidInput, match="generator, which can be read only once"):
        ss.verify(live, FAR)
    assert sum(map(len, live)) == 1500, "nothing has been taken from it"


class Measuring:
    """A source that measures the same again each time, in strips from end to end of the cloud."""

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        yield from np.array_split(CLOUD, 12)


def test_of_streams_that_come_back_it_is_known_what_was_decided_too_early() -> None:
    assert ss.verify(Measuring(), ss.Proximity(0.6, graph="radius"), revisit=True).is_identical
    assert ss.verify(CLOUD, ss.Proximity(1.0), spans=ss.SpanByCount(100), revisit=True).is_proven
    found = ss.verify(Measuring(), ss.Proximity(1.0), revisit=True)
    assert not found.is_identical
    assert found.certificate.early_decisions
    (reason,) = found.reasons
    assert "decisions about points were early, as more of the cloud could still come" in reason


class Dwindling:
    """A source that has fewer points each time."""

    def __init__(self) -> None:
        self.left = 300

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        self.left -= 100
        yield CLOUD[: self.left]


def test_a_source_that_changes_is_refused() -> None:
    with pytest.raises(ss.InvalidInput, match="200 points when read once and 100 when read again"):
        ss.verify(Dwindling(), FAR)


def test_a_cloud_beyond_the_memory_of_the_machine_is_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sysconf", lambda _: 100)
    with pytest.warns(ss.StreamsegWarning, match="1,500 points may need .* verify a part of the cloud"):
        ss.verify(CLOUD, FAR, spans=ss.SpanByWidth(2.0))
    monkeypatch.undo()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.verify(CLOUD, FAR, spans=ss.SpanByWidth(2.0))
