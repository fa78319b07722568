"""A drive whose force is limited below what the simulation says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Float, Parameter, Shape, said
from cellwatt_plugins.robot.effects.states import States

SHARES = tuple(float(s) for s in np.linspace(0.95, 0.2, 16))
"""Of the greatest torque asked for, that are tried as the limit."""
FOLLOWS = 0.5
"""Share of what is asked beyond the limit that the torque of the motion may follow."""
CLIPPED = 8
"""Samples that must be beyond the limit."""


class DriveLimit(Effect):
    """The drive gives no more than its limit, whatever its law asks for."""

    name = "torque_saturation"
    acts_on = "drive"
    form = Form(to_scale=True)
    confusions = (Confusion("drive_gain", "move slower: a soft loop stays soft, a limit is not reached"),)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        given = np.abs(np.concatenate([run.servos.torque[:, joint or 0] for run in runs]))
        levels = [share * float(np.max(given)) for share in SHARES]
        return [(level,) for level in levels if np.count_nonzero(given > level) >= CLIPPED]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        """Beyond its limit a drive gives the same whatever is asked: the motion's torque does not follow that."""
        at = joint or 0
        asked = np.concatenate([np.abs(run.servos.torque[:, at]) for run in runs])
        given = np.concatenate([run.nominal[:, at] * np.sign(run.servos.torque[:, at]) for run in runs])
        beyond = asked > shape[0]
        if np.count_nonzero(beyond) < CLIPPED:
            return False
        off = asked[beyond] - np.mean(asked[beyond])
        return float(off @ given[beyond]) <= FOLLOWS * float(off @ off)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.servos.beyond(joint or 0, -shape[0], shape[0])[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.7 * shape[0], 1.3 * shape[0])]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"limit": estimate.shaped(0, "N*m")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"The drive of {who.lower()} gives no more than {said(parameters['limit'])}: its limit is lower."
