"""The actual motion of a recorded run, and the lag of its servos behind the plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.motion import OWN_OCTAVES, Moved, Plan, about_plan, from_encoders
from cellwatt_plugins.robot.servo.law import earlier

SHORTEST_LAG, LONGEST_LAG = 0.0005, 0.2
"""Lags of a servo behind the plan, s; a shorter lag counts as tracking error."""


def moved(run: Run, octaves: Sequence[float] = OWN_OCTAVES) -> Moved:
    """The motion of a run: planned motion plus smoothed tracking error, or smoothed encoders if there is no plan.

    ``octaves``, Hz, apply to smoothed encoders only.
    """
    if run.drive is not None:
        return run.drive.moved
    if run.plan is None:
        return from_encoders(run.position, run.step, octaves, run.gaps)
    return about_plan(run.position, _followed(run), run.step, run.gaps)


def _followed(run: Run) -> Plan:
    """The plan as each joint follows it, delayed by the lag of its servo."""
    assert run.plan is not None
    plan, lag = run.plan, servo_lag(run)
    if not lag.any():
        return plan
    return Plan(*(earlier(values, lag, run.step) for values in plan.courses))


def servo_lag(run: Run) -> Float:
    """Lag (n,) s of each joint behind its plan; 0 where it is no more than tracking error."""
    lag = np.zeros(run.joints)
    if run.plan is None:
        return lag
    for _ in range(3):
        position, velocity = (earlier(part, lag, run.step) for part in (run.plan.position, run.plan.velocity))
        error, velocity = (run.position - position)[~run.filled], velocity[~run.filled]
        lag -= np.sum(error * velocity, axis=0) / np.maximum(np.sum(velocity**2, axis=0), 1e-12)
        lag = np.clip(lag, -LONGEST_LAG, LONGEST_LAG)
    return np.where(np.abs(lag) > SHORTEST_LAG, lag, 0.0)
