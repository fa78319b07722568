"""Commands that act later than they were logged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.servo.law import earlier

DELAYS = tuple((float(d),) for d in np.geomspace(0.003, 0.15, 14))
"""Delays in s that are tried."""
SHARE = 0.4
"""Smallest resolved delay, in rows: a shorter one depends on when commands were logged."""


class CommandDelay(Effect):
    """The drives follow the command of ``delay`` s before."""

    name = "time_delay"
    acts_on = "drive"
    whole_arm = True
    form = Form(to_scale=True)
    scaled_is = (("delay", "s"),)
    acceptance = Acceptance(several_channels=True)
    confusions = (Confusion("drive_gain", "move at two speeds: a delay grows with the speed, a soft loop with torque"),)
    tried = DELAYS

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        return abs(shape[0]) > SHARE * runs[0].step

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        drive = run.servos
        before = earlier(drive.command, shape[0], run.step)
        return np.asarray(drive.servo.pull * (drive.command - before))[:, :, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.001, 0.3)]

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        delay = parameters["delay"]
        return (
            f"Commands act {1000 * delay.value:.1f} ± {1000 * delay.std:.1f} ms later than they were logged: "
            "a time delay is missing."
        )
