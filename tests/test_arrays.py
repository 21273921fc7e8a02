"""Arrays as they come: fields of packed records, views, other types; what is read is what NumPy reads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import streamseg as ss
from reference.partition import same

RANDOM = np.random.default_rng(3)
POINTS = np.round(RANDOM.random((500, 3)) * 20, 2)
VALUES = RANDOM.random(500)


def packed(values: NDArray[Any], beside: int) -> NDArray[Any]:
    """The same values as a field of records with so many bytes beside it: at any byte, with any stride."""
    record = np.zeros(len(values), [("beside", f"V{beside}"), ("value", values.dtype, values.shape[1:])])
    record["value"] = values
    return record["value"]


LAYOUTS = [
    *(
        pytest.param(lambda values, beside=beside: packed(values, beside), id=f"{beside} beside")
        for beside in range(1, 17)
    ),
    pytest.param(lambda values: values[::-1][::-1], id="turned twice"),
    pytest.param(np.asfortranarray, id="columns first"),
    pytest.param(
        lambda values: np.frombuffer(b"x" + values.tobytes(), values.dtype, offset=1).reshape(values.shape),
        id="off by one",
    ),
    pytest.param(lambda values: np.repeat(values, 2, axis=0)[::2], id="every other"),
    pytest.param(lambda values: values.astype(values.dtype.newbyteorder()), id="other byte order"),
]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_points_attributes_labels_and_ids_are_read_as_they_are(layout: Any) -> None:
    assert np.array_equal(layout(POINTS), POINTS)
    expected = ss.segment_static(POINTS, ss.Proximity(1.0))
    assert np.array_equal(ss.segment_static(layout(POINTS), ss.Proximity(1.0)), expected)
    live = [layout(POINTS[:200]), layout(POINTS[200:])]
    assert same(ss.segment(live, ss.Proximity(1.0), spans=ss.SpanByWidth(3.0)), expected)
    filtered = ss.Proximity(1.0, filter="Value > 0.5")
    kept = ss.segment_static(POINTS, filtered, attributes={"Value": layout(VALUES)}) >= 0
    assert np.array_equal(kept, VALUES > 0.5)
    labels = (VALUES * 9).astype(np.int64)
    own = ss.segment_static(POINTS, lambda _: layout(labels))
    assert np.array_equal(own == own[0], labels == labels[0])
    with ss.stream(POINTS, ss.Proximity(1.0)) as run:
        ids = np.concatenate([span.segment_ids for span in run])
        assert np.array_equal(run.resolve(layout(ids)), run.resolve(ids))


@pytest.mark.parametrize("kind", [bool, complex])
def test_what_has_no_place_on_a_line_is_no_coordinate(kind: type) -> None:
    with pytest.raises(
        ss.InvalidInput, match=r"^points is an array that is no array of numbers \(\w+\), expected shape \(n, 3\)$"
    ):
        ss.segment(POINTS.astype(kind), ss.Proximity(1.0))
