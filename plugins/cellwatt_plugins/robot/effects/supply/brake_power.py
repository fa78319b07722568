"""Power of the brakes while they are released."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States

DELAYS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Times in s, from the last motion until the brakes close, that are tried."""
LEADS = (0.0, 0.1, 0.25, 0.5)
"""Times in s, from the opening of the brakes until the first motion, that are tried."""

MOSTLY = 0.97
"""Share of the time with released brakes from which brakes cannot be distinguished from standby power."""


class BrakePower(Effect):
    """Power from ``lead`` s before motion to ``delay`` s after. Shape: delay, lead."""

    name = "brake_power"
    acts_on = "supply"
    form = Form(intermittent=True)
    acceptance = Acceptance(above=0.0)
    uncertainty = Uncertainty({"power": 0.04, "delay": 0.06})
    """The time at which the arm came to rest is known to some samples."""
    confusions = (
        Confusion("iron_loss", "hold the arm with the brakes released: brakes draw power at rest, iron does not"),
        Confusion("standby_power", "record some minutes at rest, between two motions, with the brakes closed"),
    )
    coefficients_are = (("power", "W"),)
    shape_is = (("delay", "s"),)
    sentence = (
        "The supply draws {power} more from the start of motion until "
        "{delay:.2f} s after it: the power of released brakes is missing."
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        return [
            (delay, lead)
            for delay in DELAYS
            for lead in LEADS
            if np.mean(np.concatenate([released(run, delay, lead) for run in runs])) < MOSTLY
        ]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return released(run, shape[0], shape[1])[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.0, 6.0), (0.0, 1.0)]


def released(run: States, delay: float, lead: float) -> Float:
    """1 (N,) from ``lead`` s before motion to ``delay`` s after it, else 0; samples at an edge have a share."""
    moving = np.flatnonzero(run.moving)
    if not len(moving):
        return np.zeros(len(run.time))
    times = run.time[moving]
    after = np.searchsorted(times, run.time, side="right") - 1
    since = np.where(after >= 0, run.time - times[np.maximum(after, 0)], np.inf)
    before = np.searchsorted(times, run.time, side="left")
    until = np.where(before < len(times), times[np.minimum(before, len(times) - 1)] - run.time, np.inf)
    off = np.minimum(since - delay, until - lead)
    return np.asarray(np.clip(0.5 - off / run.step, 0.0, 1.0))
