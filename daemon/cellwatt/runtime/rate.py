"""Measured rate and jitter of one stream."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

KEPT = 4096
"""Samples looked at: enough for 8 s at 500 Hz."""


class RateMeter:
    """Rate and jitter over the last samples; ``nominal`` in Hz, 0 where the source sends on change."""

    def __init__(self, nominal: float) -> None:
        self.nominal = nominal
        self.samples = 0
        self._times: list[NDArray[np.int64]] = []
        self._kept = 0

    def add(self, times: NDArray[np.int64]) -> None:
        """Note samples at times (n,) ns."""
        self.samples += len(times)
        self._times.append(times)
        self._kept += len(times)
        if self._kept > 2 * KEPT:
            self._trim()

    def _trim(self) -> None:
        joined = np.concatenate(self._times)[-KEPT:] if self._times else np.empty(0, np.int64)
        self._times, self._kept = [joined], len(joined)

    def figures(self) -> dict[str, Any]:
        """Nominal and measured rate in Hz, jitter (p50, p99 of the deviation from the nominal period) in ms."""
        self._trim()
        times = self._times[0]
        out: dict[str, Any] = {"nominal_hz": self.nominal, "samples": self.samples}
        if len(times) < 3:
            return out | {"rate_hz": None, "jitter_p50_ms": None, "jitter_p99_ms": None, "last": None}
        steps = np.diff(times) * 1e-6
        period = 1e3 / self.nominal if self.nominal else float(np.median(steps))
        p50, p99 = np.percentile(np.abs(steps - period), [50, 99])
        rate = (len(times) - 1) / ((times[-1] - times[0]) * 1e-9)
        return out | {
            "rate_hz": round(float(rate), 3),
            "jitter_p50_ms": round(float(p50), 3),
            "jitter_p99_ms": round(float(p99), 3),
            "last": int(times[-1]),
        }
