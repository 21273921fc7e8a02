"""Each point without a segment has one cause: the counts add up, in every run, and are those of slow twins."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

import streamseg as ss
from reference import preprocessing as twin
from reference.roster import OURS, ROSTER, houses
from reference.scripts import Script, scripts

Ids = NDArray[np.int64]

STATIC: dict[str, Any] = {"spans": ss.SpanByCount(1 << 40), "window": ss.Window(1, 0)}
CUTS = [ss.SpanByWidth(4.0), ss.SpanByWidth(7.0, "y"), ss.SpanByWidth(2.0, 30.0), ss.SpanByCount(90), ss.SpanByTime(9)]
WINDOWS = [ss.Window(3, 1), ss.Window(2, 1), ss.Window(1, 0), ss.Window(4, 3)]
STAGES: list[list[Any]] = [
    [],
    [],
    [ss.RadiusOutlierRemoval(0.7, 4)],
    [ss.VoxelGrid(0.5)],
    [ss.StatisticalOutlierRemoval(6), ss.VoxelGrid(0.4, "nearest")],
    [ss.StatisticalOutlierRemoval(6, statistics="running")],
]
FILTERS = [None, None, "Z > 0.6", "Z > 99", "abs(normalZ) > 0.9"]


class Asked(NamedTuple):
    """A run, all but its result."""

    name: str
    seed: int
    cut: Any
    window: ss.Window
    stages: list[Any]
    filter: str | None
    seed_filter: str | None
    limits: tuple[int, int | None]
    holes: int
    """So many points have no finite coordinates."""
    threads: int
    revisit: bool

    def points(self) -> NDArray[np.float64]:
        points = houses(self.seed, 400)
        points[:: max(len(points) // self.holes, 1) if self.holes else len(points) + 1][: self.holes, 2] = np.nan
        if self.holes:
            points[0] = np.inf
        return points

    def segmentor(self) -> Any:
        segmentor = ROSTER[self.name].segmentor
        if self.name not in OURS:
            return segmentor
        least, more = self.limits
        options = {
            "filter": self.filter,
            "seed_filter": self.seed_filter,
            "min_segment_size": least,
            "max_segment_size": None if more is None else least + more,
        }
        return type(segmentor)(**{**segmentor.__getnewargs_ex__()[1], **options})

    def run(self, result: Any, **others: Any) -> tuple[Ids, ss.Stream]:
        """The ids, in input order, and the stream after its end."""
        points = self.points()
        options = {"spans": self.cut, "window": self.window, "revisit": self.revisit, **others}
        times = {"gps_time": np.arange(len(points)) / 10}
        stream = ss.stream(
            points,
            self.segmentor(),
            preprocess=self.stages,
            drop_invalid=True,
            attributes=times,
            threads=self.threads,
            result=result,
            **options,
        )
        ids = np.full(len(points), -9, np.int64)
        with stream:
            for span in stream:
                ids[span.point_ids] = span.segment_ids
        return ids, stream


asked = st.builds(
    Asked,
    st.sampled_from(list(ROSTER)),
    st.integers(0, 1 << 20),
    st.sampled_from(CUTS),
    st.sampled_from(WINDOWS),
    st.sampled_from(STAGES),
    st.sampled_from(FILTERS),
    st.sampled_from([None, None, "Z > 1.5"]),
    st.tuples(st.integers(1, 12), st.none() | st.integers(0, 40)),
    st.sampled_from([0, 0, 3]),
    st.integers(1, 3),
    st.sampled_from([False, False, True]),
)


def can_run(asked: Asked) -> bool:
    """Whether the run is not refused."""
    segmentor = ROSTER[asked.name].segmentor
    has_neighborhood = hasattr(segmentor, "search_radius")
    needs_one = asked.filter is not None and "normal" in asked.filter
    return (has_neighborhood or not needs_one) and (asked.name in OURS or not asked.revisit)


@given(asked.filter(can_run))
@example(Asked("planes", 3, CUTS[3], WINDOWS[1], STAGES[4], "abs(normalZ) > 0.9", "Z > 1.5", (5, 30), 3, 2, True))
@example(Asked("growing, no limit", 3, CUTS[2], WINDOWS[0], [], "abs(normalZ) > 0.9", None, (2, None), 3, 2, False))
def test_the_causes_of_any_run_add_up(asked: Asked) -> None:
    with warnings.catch_warnings(), TemporaryDirectory() as folder:
        warnings.simplefilter("ignore", ss.StreamsegWarning)
        try:
            carried, carry = asked.run("carry", history=Path(folder) / "past")
        except ss.InvalidParameter as refused:
            assert "revisit" in str(refused)  # noqa: PT017 (only a revisit without a reach is refused)
            return
        final, run = asked.run("final")
        for ids, stream in ((carried, carry), (final, run)):
            assert stream.unlabelled.total == np.count_nonzero(ids == -1)
            assert np.all(ids != -9)
        raw, all_told = carry.unlabelled, run.unlabelled
        assert json.loads((Path(folder) / "past" / "manifest.json").read_text())["unlabelled"] == raw._asdict()

        # What is left out of wholes comes on top, and nothing else differs.
        wholes = carry.resolve(carried)
        seeded = carry.resolve(carried, limits=True) if asked.seed_filter is None else None
        assert seeded is None or np.array_equal(seeded == -1, final == -1)
        sizes = np.bincount(wholes[wholes != -1], minlength=1)
        if asked.seed_filter is None and asked.name in OURS:
            least, more = asked.limits
            assert all_told.too_small == sizes[sizes < least].sum()
            assert all_told.too_large == (0 if more is None else sizes[sizes > least + more].sum())
        assert raw._replace(no_seed=0) == all_told._replace(no_seed=0, too_small=0, too_large=0)
        assert all_told.total - raw.total == run.left_out.points

        static, whole = asked.run("final", **STATIC, revisit=False)
        assert whole.unlabelled.total == np.count_nonzero(static == -1)
        if run.is_proven:
            assert all_told == whole.unlabelled
        assert_twins(asked, whole.unlabelled, static)


def assert_twins(asked: Asked, told: ss.Unlabelled, static: Ids) -> None:
    """Compare the causes of a static run with what NumPy, SciPy and scikit-learn say."""
    points = asked.points()
    valid = np.isfinite(points).all(axis=1)
    assert told.invalid == np.count_nonzero(~valid)
    if asked.name not in OURS:
        assert told._replace(invalid=0, removed=0, by_segmentor=0).total == 0
        return
    stays = valid.copy()
    if asked.stages and isinstance(asked.stages[0], ss.RadiusOutlierRemoval):
        stays[valid] = twin.radius_inliers(points[valid], 0.7, 4)
        assert told.removed == np.count_nonzero(valid & ~stays)
    is_simple = all(isinstance(stage, ss.RadiusOutlierRemoval) for stage in asked.stages)
    if is_simple and (asked.filter is None or "Z >" in asked.filter):
        passes = stays & (points[:, 2] > float((asked.filter or "Z > -9").split()[-1]))
        assert told.filtered == np.count_nonzero(stays & ~passes)
        if asked.name == "dbscan" and passes.any():
            noise = DBSCAN(eps=0.75, min_samples=6).fit_predict(points[passes])
            assert told.noise == np.count_nonzero(noise == -1)
    if asked.seed_filter is None:
        assert told.no_seed == 0
    assert told.undecided == told.by_segmentor == 0


@given(scripts, st.integers(1, 4))
def test_a_point_with_a_label_in_any_window_has_no_cause(script: Script, least: int) -> None:
    def segmentor(window: ss.WindowPoints) -> Ids:
        return script.segmentor()(window)

    segmentor.min_segment_size = least  # type: ignore[attr-defined]
    for result in ("carry", "final"):
        with ss.stream(script.spans(), segmentor, window=script.window, result=result) as run:
            ids = np.concatenate([span.segment_ids for span in run] or [np.empty(0, np.int64)])
        told = run.unlabelled
        assert told.total == np.count_nonzero(ids == -1)
        assert told.total == told.by_segmentor + (told.too_small if result == "final" else 0)


def test_points_of_a_voxel_share_its_cause() -> None:
    points = np.repeat([[0.25, 0, 0], [0.75, 0, 0], [1.25, 0, 0], [9.0, 0, 0]], [3, 4, 5, 6], axis=0)
    with ss.stream(points, ss.Dbscan(0.6, 2), preprocess=ss.VoxelGrid(0.5), result="final") as run:
        ids = np.concatenate([span.segment_ids for span in run])
    assert ids.tolist() == [1] * 12 + [-1] * 6
    assert run.unlabelled == ss.Unlabelled(noise=6)


@pytest.mark.parametrize("result", ["carry", "final"])
def test_a_stopped_run_counts_what_came_out(result: Any) -> None:
    spans = (np.column_stack([index + np.zeros(10), 9.0 * np.arange(10), np.zeros(10)]) for index in range(99))
    told = []
    run = ss.stream(spans, ss.Dbscan(1.5, 3), result=result, on_progress=lambda progress: told.append(progress))
    if result == "carry":
        taken = [next(run).segment_ids for _ in range(3)]
    else:
        run.stop()
        taken = [span.segment_ids for span in run]
    assert run.unlabelled.total == np.count_nonzero(np.concatenate([np.empty(0, np.int64), *taken]) == -1)
    run.close()


def test_nothing_is_told_before_the_first_final_ids() -> None:
    run = ss.stream(np.zeros((3, 3)), ss.Dbscan(1.0, 9), result="final")
    assert run.unlabelled == ss.Unlabelled()
    assert str(run.unlabelled) == "none"
    list(run)
    assert run.unlabelled == ss.Unlabelled(noise=3)
    assert (str(run.unlabelled), run.unlabelled.causes) == ("3 noise", {"noise": 3})


def test_causes_are_told_by_their_number() -> None:
    told = ss.Unlabelled(filtered=20, too_small=1, in_no_plane=1_000)
    assert str(told) == "1,000 in no plane, 20 left out by the filter, 1 in segments that are too small"
    assert list(told.causes) == ["in_no_plane", "filtered", "too_small"]
    assert told.total == 1_021


def test_of_files_the_points_that_are_written_count(tmp_path: Path) -> None:
    points = np.repeat(np.arange(5.0), [1, 2, 3, 4, 5])[:, None] * [10, 0, 0]
    points[0] = np.nan
    np.savetxt(tmp_path / "in.xyz", points)
    segmentor = ss.Proximity(1.0, min_segment_size=3, max_segment_size=4)
    for name, written, invalid in (("out.xyz", 15, 1), ("out.npy", 15, 1), ("out.las", 14, 0)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ss.StreamsegWarning)
            outcome = ss.segment_file(tmp_path / "in.xyz", tmp_path / name, segmentor, drop_invalid=True)
        assert outcome.points == written, name
        assert outcome.unlabelled == ss.Unlabelled(invalid=invalid, too_small=2, too_large=5), name
        assert outcome.left_out_by_cause == {"too_small": ss.LeftOut(1, 2), "too_large": ss.LeftOut(1, 5)}
        assert outcome.left_out == ss.LeftOut(2, 7)


def test_verify_tells_who_has_no_segment() -> None:
    points = np.repeat([[0.0, 0, 0], [9, 0, 0]], [5, 2], axis=0)
    found = ss.verify(points, ss.Proximity(1.0, min_segment_size=3), spans=ss.SpanByWidth(4.0))
    assert (found.unlabelled, found.static_unlabelled) == (ss.Unlabelled(too_small=2), 2)
    assert "2 of the points have no segment: 2 in segments that are too small" in str(found)


@pytest.mark.filterwarnings("ignore:windows share no span")
@pytest.mark.parametrize(
    ("name", "segmentor", "spans"),
    [
        ("isprs/CSite3.laz", ss.PlaneExtraction(1.5, max_distance=0.2, filter="Z < 300"), ss.SpanByWidth(70.0)),
        ("als/mixed_conifer.laz", ss.RegionGrowing(12, min_segment_size=20), ss.SpanByWidth(9.0, "y")),
        ("als/mixed_conifer.laz", ss.Dbscan(0.8, 6, seed_filter="Z > 10"), ss.SpanByCount(5000)),
    ],
)
def test_causes_of_measured_clouds_add_up(data: Path, name: str, segmentor: Any, spans: Any) -> None:
    told = []
    for options in ({"spans": spans}, STATIC):
        with ss.stream(data / name, segmentor, result="final", with_points=False, **options) as run:
            ids = np.concatenate([span.segment_ids for span in run])
        assert run.unlabelled.total == np.count_nonzero(ids == -1) > 0
        assert len(run.unlabelled.causes) > 1
        told.append((run.unlabelled, run.is_proven))
    if told[0][1]:
        assert told[0][0] == told[1][0]
