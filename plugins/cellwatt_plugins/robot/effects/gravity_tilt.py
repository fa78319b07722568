"""A base that is not level."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Float, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States


class GravityTilt(Effect):
    """Gravity turned by roll and pitch about the base's x and y axes."""

    name = "gravity_tilt"
    acts_on = "links"
    whole_arm = True
    acceptance = Acceptance(several_channels=True)
    uncertainty = Uncertainty({"roll": 0.015, "pitch": 0.015})
    """The weight that tilts is as uncertain as the links."""
    confusions = (
        Confusion("payload", "turn joint 1 about its vertical axis: a tilt loads it, a payload does not"),
        Confusion("link_inertial_error", "turn joint 1 about its vertical axis"),
    )

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        down = -float(run.arm.body.gravity_field[2])
        parts = [run.arm.body.with_gravity(np.array(g)).gravity(run.q) for g in ((down, 0.0, 0.0), (0.0, down, 0.0))]
        # Rolling the base by r turns gravity towards -y of the base, pitching by p towards +x.
        return np.stack([-parts[1], parts[0]], axis=2)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"roll": estimate.coefficient(0, "rad"), "pitch": estimate.coefficient(1, "rad")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        roll, pitch = (np.degrees(parameters[n].value) for n in ("roll", "pitch"))
        return f"The base is not level: it leans {roll:.1f}° in roll and {pitch:.1f}° in pitch."
