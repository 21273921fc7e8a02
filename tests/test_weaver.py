"""The weaver against its twin, which follows the paper to the letter."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import example, given

import streamseg as ss
from reference import history
from reference.scripts import Script, scripts
from reference.weaver import NONE, Weaver, final_ids

# As in figure 1: windows of three spans that share one; segments meet from the left, from the right and not at all.
FIGURE = Script([2, 2, 2, 2, 2, 2, 2], ss.Window(3, 1), [0, 0, 1, 1, 2, NONE, 3, 0, 1])
# Two points that are apart in the first two windows and together in the third.
LATE = Script([2, 2, 2, 2], ss.Window(2, 1), [0, 1, 0, 1, 2, 0, 0, 0, 0, 1, 0])


@given(scripts)
@example(FIGURE)
@example(LATE)
@example(Script([0, 0, 3, 0], ss.Window(2, 1), [0, NONE]))
@example(Script([1], ss.Window(3, 1), [NONE]))
def test_ids_and_files_equal_the_twins(script: Script) -> None:
    twin, _ = script.weave()
    with TemporaryDirectory() as folder:
        path = Path(folder, "run")
        with ss.stream(script.spans(), script.segmentor(), window=script.window, history=path, result="history") as run:
            streamed = {
                point: segment
                for span in run
                for point, segment in zip(span.point_ids.tolist(), span.segment_ids.tolist(), strict=True)
            }
        points = history.table(path, "point_segment")
        segments = history.table(path, "segment_segment")
    expected = {point: twin.point_segment_file.get(point, NONE) for point in range(sum(script.span_points))}
    assert streamed == expected
    assert dict(points[:, :2].tolist()) == expected
    assert [tuple(row) for row in segments.tolist()] == sorted(twin.segment_segment_file)


@given(scripts)
@example(FIGURE)
def test_spans_and_windows_of_the_history(script: Script) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, "run")
        list(ss.stream(script.spans(), script.segmentor(), window=script.window, history=path))
        points = history.table(path, "point_segment")
        windows = history.table(path, "window")
    assert points[:, 2].tolist() == np.repeat(np.arange(len(script.span_points)), script.span_points).tolist()
    given_ids = 1
    for index, (row, members) in enumerate(zip(windows.tolist(), script.windows(), strict=True)):
        labels = [script.label(index, point) for point in members]
        segments = len(set(labels) - {NONE})
        first = index * script.window.advance
        spans = min(script.window.spans, len(script.span_points) - first)
        assert row[:6] == [index, first, spans, len(members), given_ids, segments]
        # In stream order more may come to any place, so all that is said is early; nothing waits or returns.
        assert row[6:] == [0, 0, 0, 0, 0, len(labels)]
        given_ids += segments


@given(scripts)
@example(FIGURE)
@example(LATE)
def test_the_tables_hold_what_is_in_scope_and_nothing_else(script: Script) -> None:
    _, entries = script.weave()
    windows = script.windows()
    with ss.stream(script.spans(), script.segmentor(), window=script.window, threads=1) as run:
        assert run.live_entries == (0, 0)
        for _ in run:
            woven = run.progress.windows
            if run.live_entries == (0, 0) and woven == len(windows):
                continue
            assert run.live_entries == entries[woven - 1]
            assert run.live_entries[0] <= len(set(windows[woven - 1]) | set(windows[max(woven - 2, 0)]))
        assert run.live_entries == (0, 0)


@given(scripts)
@example(FIGURE)
@example(LATE)
def test_final_ids_equal_the_twins(script: Script) -> None:
    twin, _ = script.weave()
    final = final_ids((row.segment_id, row.next_segment_id) for row in twin.segment_segment_file)
    expected = [final.get(twin.point_segment_file.get(point, NONE), NONE) for point in range(sum(script.span_points))]
    assert ss.segment(script.spans(), script.segmentor(), window=script.window).tolist() == expected


def test_the_twin_finds_the_figure_in_the_paper() -> None:
    # Section 2.1.2: after the first segmentation all segments are paired with −1; after the second, segment 1 "now has
    # segment 4 to its right"; points that were there keep their segment.
    weaver = Weaver()
    weaver.segmentation([0, 1, 2, 3, 4, 5], [7, 7, 8, 8, 9, 7])
    assert weaver.point_segment == {0: 1, 1: 1, 2: 2, 3: 2, 4: 3, 5: 1}
    assert weaver.segment_segment == {1: {}, 2: {}, 3: {}}
    weaver.segmentation([4, 5, 6, 7], [1, 0, 0, 1])
    assert weaver.point_segment == {0: 1, 1: 1, 2: 2, 3: 2, 4: 3, 5: 1, 6: 5, 7: 4}
    assert weaver.segment_segment == {1: {5: 1}, 2: {}, 3: {4: 1}, 4: {}, 5: {}}
    weaver.segmentation([7, 8], [0, 0])
    assert weaver.point_segment_file == {0: 1, 1: 1, 2: 2, 3: 2}
    assert [tuple(row) for row in weaver.segment_segment_file] == [(2, -1, -1, 0)]
    weaver.last_segmentation()
    assert sorted(weaver.point_segment_file) == list(range(9))
    assert not weaver.segment_segment


def test_windows_that_share_nothing_are_not_joined() -> None:
    script = Script([2, 2, 2], ss.Window(1, 0), [0])
    with pytest.warns(ss.StreamsegWarning, match="share no span"):
        labels = ss.segment(script.spans(), script.segmentor(), window=script.window)
    assert labels.tolist() == [1, 1, 2, 2, 3, 3]
