"""A delay between torque and position that grows with time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Confusion
from cellwatt_plugins.robot.effects.effect import Parameter, Shape
from cellwatt_plugins.robot.effects.measurement.time_delay import Lateness, shifted
from cellwatt_plugins.robot.effects.states import States

APART = tuple(sign * float(s) for s in np.geomspace(0.004, 0.15, 10) for sign in (1, -1))
"""Drifts that are tried, in s at the end of the longest run, so close to each other that one of them is within the
scale that is accepted."""


class ClockDrift(Lateness):
    """Torque of t - rate · (t - start of the run)."""

    name = "clock_drift"
    scaled_is = (("rate", "s/s"),)
    confusions = (Confusion("time_delay", "record for longer: a delay is constant, a drift grows"),)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        longest = max(float(run.time[-1] - run.time[0]) for run in runs)
        return [(apart / longest,) for apart in APART]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        # Channels logged in one row, and compared with no plan, share one clock.
        return not any(run.unplanned for run in runs)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return (shifted(run.time, run.torque, shape[0] * (run.time - run.time[0])) - run.torque)[:, :, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        slow, fast = 0.3 * shape[0], 3.0 * shape[0]
        return [(min(slow, fast), max(slow, fast))]

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        rate = parameters["rate"]
        return (
            f"Torque and position drift apart by {1000 * rate.value:.3g} ± {1000 * rate.std:.2g} ms per second: "
            "the two clocks drift."
        )
