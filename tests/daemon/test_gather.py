"""Samples gather: on one grid in all processes, for as long as the settings and the subscribers say."""

from __future__ import annotations

import time

import pytest

from cellwatt.config import FrameSettings
from cellwatt.gather import next_moment
from tests.daemon.runtime.fakes import config_of


@pytest.mark.parametrize(("period", "after"), [(0.01, 0.0), (0.04, 0.0015), (0.005, 0.003)])
def test_moments_lie_on_one_grid_and_ahead(period: float, after: float) -> None:
    before = time.monotonic()
    moment = next_moment(period, after)
    steps = (moment - after) / period
    assert abs(steps - round(steps)) < 1e-3
    assert before < moment <= time.monotonic() + period


@pytest.mark.parametrize(
    ("frames", "latency", "awaited", "unawaited"),
    [
        (FrameSettings(), "normal", 0.010, 0.040),
        (FrameSettings(rate=100.0), "normal", 0.005, 0.040),
        (FrameSettings(rate=50.0, latency=0.05), "normal", 0.010, 0.020),
        (FrameSettings(rate=50.0, latency=0.02), "normal", 0.010, 0.010),
        (FrameSettings(), "low", 0.0, 0.0),
    ],
)
def test_how_long_samples_gather(frames: FrameSettings, latency: str, awaited: float, unawaited: float) -> None:
    config = config_of(frames=frames, latency=latency)
    assert config.gather(awaited=True) == pytest.approx(awaited)
    assert config.gather(awaited=False) == pytest.approx(unawaited)
