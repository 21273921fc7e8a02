"""Labels of any type: names that tell segments apart, read as they are, or refused in a sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference.partition import same
from streamseg.io import LabelSpool
from streamseg.io.labels import as_whole

POINTS = np.column_stack([np.arange(60.0), np.zeros((60, 2))])
THIRDS = np.repeat([0, 1, 2], 20)


def labelled(labels: Any) -> NDArray[np.int64]:
    return ss.segment_static(POINTS, lambda _: labels)


@pytest.mark.parametrize(
    "names",
    [
        np.array([2**63, 2**63 + 1, 2**64 - 2], np.uint64),
        np.array([0, 2**63 - 1, 2**63], np.uint64),
        np.array([0, 2**32 - 2, 2**31], np.uint32),
        np.array([0, 255, 256], np.uint16),
        np.array([0, 254, 128], np.uint8),
        np.array([0, 2**63 - 1, 2**32 - 1], np.int64),
        np.array([0, 127, 1], np.int8),
    ],
    ids=lambda names: f"{names.dtype} up to {names.max()}",
)
def test_no_whole_number_wraps(names: NDArray[Any]) -> None:
    for order in (names, names.astype(names.dtype.newbyteorder())):
        labels = labelled(order[THIRDS])
        assert same(labels, THIRDS)
        assert labels.min() == 1


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32, np.uint64])
def test_what_none_becomes_in_an_unsigned_type_is_refused(kind: type[Any]) -> None:
    wrapped = np.where(THIRDS == 1, -1, THIRDS).astype(kind)
    largest = np.iinfo(kind).max
    with pytest.raises(ss.SegmentorError, match=rf"returned the label {largest} of type uint\d+, .* -1 = none"):
        labelled(wrapped)
    with pytest.raises(ss.SegmentorError, match=r"^segmentor '<lambda>' returned the label 4294967295 of type uint64"):
        labelled(np.full(60, -1, np.int32).astype(np.uint32).astype(np.uint64))


@pytest.mark.parametrize("kind", [np.int32, np.uint64, bool])
def test_what_is_masked_has_no_segment(kind: type[Any]) -> None:
    # What is below a mask is whatever it is.
    under = np.where(THIRDS == 2, -1 if kind is np.uint64 else -7, THIRDS).astype(kind)
    labels = labelled(np.ma.masked_array(under, THIRDS == 2))
    assert np.array_equal(labels == -1, THIRDS == 2)
    assert same(labels[:40], THIRDS[:40])


@pytest.mark.parametrize(
    ("labels", "given"),
    [
        ([2**64, *range(59)], "object"),
        ([2**63, -1, *range(58)], "(float64|object)"),
        (THIRDS.astype(np.float32), "float32"),
        (THIRDS.astype(complex), "complex128"),
        (THIRDS.astype("M8[s]"), r"datetime64\[s\]"),
        (THIRDS.astype(str), "<U21"),
        (THIRDS.astype([("label", int)]), r"\[\('label', '<i8'\)\]"),
    ],
    ids=["beyond 64 bits", "of both kinds", "float", "complex", "time", "text", "record"],
)
def test_what_is_no_whole_number_is_refused(labels: Any, given: str) -> None:
    with pytest.raises(ss.SegmentorError, match=f"returned labels of type {given}, expected whole numbers; -1 = none$"):
        labelled(labels)


def test_ids_that_are_kept_do_not_wrap_either() -> None:
    assert as_whole(np.array([2**63 - 1], np.uint64)).tolist() == [2**63 - 1]  # type: ignore[union-attr]
    assert as_whole(np.array([3.0, -1.0])).tolist() == [3, -1]  # type: ignore[union-attr]
    for odd in (np.array([2**63], np.uint64), np.array([2.0**63]), np.array([np.inf]), np.array([np.nan])):
        assert as_whole(odd) is None
    with (
        LabelSpool() as spool,
        pytest.raises(ss.InvalidInput, match=r"has 9223372036854775808, expected .* below 2\^63"),
    ):
        spool.add(np.array([0]), np.array([2**63], np.uint64))


@pytest.mark.parametrize("is_live", [True, False], ids=["live", "stored"])
def test_what_is_masked_of_points_and_attributes_has_no_value(is_live: bool) -> None:
    points = np.ma.masked_array(POINTS, np.broadcast_to((THIRDS == 1)[:, None], POINTS.shape))
    values = np.ma.masked_array(np.ones(60, np.uint8), THIRDS == 2)
    near = ss.Proximity(1.5, filter="Value > 0")
    if is_live:
        labels = ss.segment(iter([(points, {"Value": values})]), near, attributes=["Value"], drop_invalid=True)
    else:
        labels = ss.segment(points, near, attributes={"Value": values}, drop_invalid=True)
    assert np.array_equal(labels != -1, THIRDS == 0)


@pytest.mark.parametrize("kind", ["complex128", "datetime64[s]", "timedelta64[s]", "<U21"])
@pytest.mark.parametrize("is_live", [True, False], ids=["live", "stored"])
def test_attributes_and_points_that_are_no_numbers_are_refused(kind: str, is_live: bool) -> None:
    def source(points: Any, values: Any) -> tuple[Any, Any]:
        return (iter([(points, {"gps_time": values})]), None) if is_live else (points, {"gps_time": values})

    for points, values, name in (
        (POINTS, np.arange(60).astype(kind), "gps_time"),
        (POINTS.astype(np.int64).astype(kind), THIRDS, "points"),
    ):
        given, attributes = source(points, values)
        with pytest.raises(ss.InvalidInput, match=f"^{name} is .*no array of numbers"):
            ss.segment(given, ss.Proximity(1.5), spans=ss.SpanByTime(0.5), attributes=attributes)
