"""The motion that really took place in a recorded run, and how far its servos lag behind the plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.motion import OWN_OCTAVES, Moved, Plan, about_plan, from_encoders

SHORTEST_LAG, LONGEST_LAG = 0.0005, 0.2
"""s that a servo may lag behind the plan; less is tracking error."""


def moved(run: Run, octaves: Sequence[float] = OWN_OCTAVES) -> Moved:
    """The motion of a run: planned motion plus smoothed tracking error, or smoothed encoders where no plan is.

    ``octaves``, Hz, are those of smoothed encoders.
    """
    if run.drive is not None:
        return run.drive.moved
    if run.plan is None:
        return from_encoders(run.position, run.step, octaves)
    return about_plan(run.position, _followed(run), run.step)


def _followed(run: Run) -> Plan:
    """The plan as each joint follows it: a servo that lags behind does the same motion a little later."""
    assert run.plan is not None
    plan, lag = run.plan, servo_lag(run)
    if not lag.any():
        return plan
    return Plan(*(later(values, run.time, lag) for values in plan.courses))


def servo_lag(run: Run) -> Float:
    """s (n,) by which each joint follows its plan later; 0 where that is no more than tracking error."""
    lag = np.zeros(run.joints)
    if run.plan is None:
        return lag
    for _ in range(3):
        position, velocity = (later(part, run.time, lag) for part in (run.plan.position, run.plan.velocity))
        error = run.position - position
        lag -= np.sum(error * velocity, axis=0) / np.maximum(np.sum(velocity**2, axis=0), 1e-12)
        lag = np.clip(lag, -LONGEST_LAG, LONGEST_LAG)
    return np.where(np.abs(lag) > SHORTEST_LAG, lag, 0.0)


def later(values: Float, time: Float, lag: Float) -> Float:
    """Values (N, n) of ``lag`` (n,) s ago."""
    return np.stack([np.interp(time - s, time, values[:, j]) for j, s in enumerate(lag)], axis=1)
