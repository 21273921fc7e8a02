"""Features as a stream are those of the whole cloud, bit for bit."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import streamseg as ss

NAMES = ["NormalX", "NormalSigma0", "SurfaceVariation", "MeanCurvature", "NeighborCount"]
CLOUDS = {"lidarhd": "als/lidarhd_77050_627755.laz", "topography": "als/topography.laz"}


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in NAMES)


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("search", [{"search_radius": 1.2}, {"k": 12, "search_radius": 2.0}], ids=["radius", "nearest"])
def test_streamed_features_are_static_ones(name: str, search: dict[str, Any], data: Path) -> None:
    source = data / CLOUDS[name]
    static = ss.features(source, NAMES, **search)
    for spans in (ss.SpanByWidth(8.0), ss.SpanByWidth(15.0, "y"), ss.SpanByWidth(31.0, 30.0)):
        assert same(ss.features(source, NAMES, spans=spans, threads=2, **search), static)


def test_values_that_a_window_cannot_know_are_missing_and_counted() -> None:
    random = np.random.default_rng(1)
    cluster = random.uniform(0.0, 40.0, (4000, 3)) * [1.0, 1.0, 0.1]
    cloud = np.concatenate([cluster, [[80.0, 0.0, 0.0], [90.0, 0.0, 0.0]]])
    static = ss.features(cloud, NAMES, k=10)
    with pytest.warns(ss.StreamsegWarning, match=r"^\d+ of 4,002 points have no value, because .* use wider spans"):
        streamed = ss.features(cloud, NAMES, k=10, spans=ss.SpanByWidth(5.0))
    known = ~np.isnan(streamed["NeighborCount"])
    assert 3000 < known.sum() <= 4001
    assert all(np.array_equal(streamed[name][known], static[name][known], equal_nan=True) for name in NAMES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert same(ss.features(cloud, NAMES, k=10, spans=ss.SpanByWidth(1000.0)), static)
