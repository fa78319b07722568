"""Friction that differs by direction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Form, Relations
from cellwatt_plugins.robot.effects.effect import Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding
from cellwatt_plugins.robot.effects.states import States

BOTH, UP, DOWN = 0.0, 1.0, -1.0


class AsymmetricFriction(Friction):
    """More friction one way than the other: half the difference each way, or all of it one way."""

    name = "asymmetric_friction"
    acts_on = "friction"
    relations = Relations(along="velocity", beats=("torque_offset",))
    form = Form(reverses=True)
    confusions = (
        Confusion("torque_offset", "hold the arm still: an offset remains, friction vanishes"),
        Confusion("load_dependent_friction", "sweep where gravity loads the joint the other way"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        described = runs[0].arm.column("coulomb_friction")[joint or 0]
        # Friction one way only is half of it both ways plus an offset: not tried where friction itself is unknown.
        return [(BOTH,), (UP,), (DOWN,)] if described > 0 else [(BOTH,)]

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        if shape[0] == BOTH:
            return 0.5 * np.abs(sliding.sign)
        return np.maximum(shape[0] * sliding.sign, 0.0) * shape[0]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"difference": estimate.coefficient(0, "N*m", -1.0 if estimate.shape[0] == DOWN else 1.0)}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        more = "positive" if parameters["difference"].value > 0 else "negative"
        size = Parameter(abs(parameters["difference"].value), parameters["difference"].std, "N*m")
        return f"{who} has {size} more friction in {more} direction than in the other: friction is asymmetric."
