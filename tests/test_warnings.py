"""Warnings: one sentence each, at the caller's line."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import streamseg as ss

POINTS = np.column_stack([np.arange(50.0), np.zeros((50, 2))])
NEAR = ss.Proximity(1.5)


def test_spans_too_narrow_for_the_distance_are_warned_of_in_one_sentence() -> None:
    with pytest.warns(ss.StreamsegWarning) as caught:
        run = ss.stream(POINTS, NEAR, spans=ss.SpanByWidth(1.0))
    (warning,) = caught
    assert str(warning.message) == run.warning
    assert run.warning == (
        "windows overlap by 1, less than the distance 1.5: the result may differ from the static one; "
        "use wider spans or more overlap"
    )
    assert warning.filename == __file__
    assert not run.is_identical


def test_windows_that_share_no_span_are_warned_of_in_one_sentence() -> None:
    with pytest.warns(ss.StreamsegWarning, match="^windows share no span, so segments are cut") as caught:
        ss.segment(POINTS, NEAR, spans=ss.SpanByWidth(10.0), window=ss.Window(2, 0))
    (warning,) = caught
    assert issubclass(warning.category, UserWarning)


def test_warnings_of_segment_point_at_the_caller() -> None:
    with pytest.warns(ss.StreamsegWarning) as caught:
        ss.segment(POINTS, NEAR, spans=ss.SpanByWidth(1.0))
    assert caught[0].filename == __file__


def test_a_warning_never_calls_a_length_less_than_itself() -> None:
    # Real coordinates have no lattice, so an overlap of just the distance is not enough; the sentence has to say why.
    with pytest.warns(ss.StreamsegWarning) as caught:
        ss.stream(POINTS, ss.Proximity(2.0), spans=ss.SpanByWidth(2.0))
    assert "overlap by 2, less than the distance 2:" not in str(caught[0].message)


def test_a_cloud_without_scan_lines_is_one_span_and_that_is_told() -> None:
    points = np.column_stack([np.arange(90.0), np.zeros((90, 2))])
    flat, turning = np.zeros(90), (np.arange(90) // 30) % 2
    for direction, edge, lines in ((flat, flat, 0), (turning, flat, 3), (flat, np.arange(90) % 30 == 29, 3)):
        flags = {"scan_direction_flag": direction, "edge_of_flight_line": edge.astype(float)}
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with ss.stream(points, ss.Proximity(1.5), spans=ss.SpanByScanLine(1), attributes=flags) as run:
                assert len(list(run)) == max(lines, 1)
        told = [str(warning.message) for warning in caught]
        assert [sentence.startswith("not one scan line ends in the first 90 points") for sentence in told] == (
            [] if lines else [True]
        )
