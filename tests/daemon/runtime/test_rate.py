from __future__ import annotations

import numpy as np
import pytest

from cellwatt.runtime.source import WINDOW, RateMeter


def test_rate_and_jitter_of_a_known_stream() -> None:
    meter = RateMeter()
    times = np.arange(1000, dtype=np.int64) * 10_000_000
    times[1::2] += 1_000_000  # every other sample 1 ms late: each step is off by 1 ms
    for block in np.split(times, 10):
        meter.add(block)
    figures = meter.figures(100.0)
    assert figures["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    assert figures["jitter_p50_ms"] == figures["jitter_p99_ms"] == 1.0
    assert figures["samples"] == 1000


def test_memory_stays_bounded() -> None:
    meter = RateMeter()
    for i in range(100):
        meter.add(np.arange(1000, dtype=np.int64) + 1000 * i)
    assert meter._count <= 2 * WINDOW
    assert meter.figures(500.0)["samples"] == 100_000
