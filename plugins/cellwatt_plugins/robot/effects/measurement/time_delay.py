"""Torque and position channels that were not sampled at the same time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Relations
from cellwatt_plugins.robot.effects.effect import Effect, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST

DELAYS = tuple((sign * float(d),) for d in np.geomspace(0.002, 0.1, 11) for sign in (1, -1))
"""Delays in s that are tried, so close to each other that one of them is within the scale that is accepted."""

UNPLANNED = 1.0
"""Smallest resolved delay, in samples, without a plan: logs read the channels of a row one after the other."""
LEAST = 0.6
"""Smallest resolved delay, in steps: simulators log a step's torque after the step, which looks like a delay."""
CYCLE = 0.01
"""Longest step in s of simulation or control; a recording with longer intervals was decimated."""


class Lateness(Effect):
    """Torques of another time than the positions."""

    acts_on = "reading"
    depends_on = "fitted torque"
    whole_arm = True
    form = Form(to_scale=True)
    # A delay and a drift together fit any signal that is early in one half of a run and late in the other.
    relations = Relations(family="lateness")
    acceptance = Acceptance(least_rate=FAST, exact_times=True, several_channels=True)


class TimeDelay(Lateness):
    """Torque of t - delay; the delay is negative if the torque comes first."""

    name = "time_delay"
    scaled_is = (("delay", "s"),)
    confusions = (
        Confusion("rotor_inertia", "run the same path at two speeds: a delay shows with the change of torque"),
        Confusion("clock_drift", "record for longer: a drift grows"),
    )
    tried = DELAYS

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        step = runs[0].step
        least = UNPLANNED * step if any(run.unplanned for run in runs) else LEAST * min(step, CYCLE)
        return abs(shape[0]) > least

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return (shifted(run.time, run.torque, shape[0]) - run.torque)[:, :, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(-0.2, 0.2)]

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        delay = parameters["delay"]
        way = "behind" if delay.value > 0 else "ahead of"
        return (
            f"The torque channels run {1000 * abs(delay.value):.1f} ± {1000 * delay.std:.1f} ms {way} the positions: "
            "a time delay is missing."
        )


def shifted(time: Float, values: Float, delay: float | Float) -> Float:
    """Values (N, n) at ``delay`` s earlier, a number or (N,), by cubic splines; the end values are held."""
    return np.asarray(CubicSpline(time, values)(np.clip(time - delay, time[0], time[-1])))
