"""Measured torque that is clipped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Float, Parameter, Shape, said
from cellwatt_plugins.robot.effects.states import States

BELOW = (0.0, 1.0, 2.0, 3.0)
"""Standard deviations below the greatest measured torque at which the limit is tried."""
CLIPPED = 10
"""Samples that must be clipped."""
AMONG = (10, 20, 40)
"""Greatest asked torques over whose readings the limit is also tried: clipped ones all read about the same."""


class TorqueSaturation(Effect):
    """Torque beyond a limit reads as the limit."""

    name = "torque_saturation"
    acts_on = "reading"
    depends_on = "residual"
    form = Form(to_scale=True)
    confusions = (Confusion("torque_gain", "move slower: a gain stays, clipping goes"),)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        # A torque that is clipped never reads more than the limit.
        read = np.concatenate(
            [np.abs(run.torque[:, joint] + r[:, joint]) for run, r in zip(runs, residual, strict=True)]
        )
        asked = np.concatenate([np.abs(run.torque[:, joint]) for run in runs])
        # Of the reading alone: what the model does not explain yet is no noise of it.
        spread = float(np.median(np.abs(np.diff(read)))) / 0.6745
        levels = [float(np.max(read)) - below * spread for below in BELOW]
        greatest = np.argsort(-asked)[: max(AMONG)]
        levels += [float(np.median(read[greatest[:count]])) for count in AMONG]
        return [(level,) for level in levels if level > 0 and np.count_nonzero(asked > level) >= CLIPPED]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        torque = run.torque[:, joint]
        return (np.clip(torque, -shape[0], shape[0]) - torque)[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.85 * shape[0], 1.15 * shape[0])]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"limit": estimate.shaped(0, "N*m")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"The torque measured at {who.lower()} is clipped at {said(parameters['limit'])}."
