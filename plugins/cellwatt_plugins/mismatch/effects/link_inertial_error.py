"""Mass, centre of mass or inertia of a link well off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt_plugins.mismatch.effects.effect import Confusion, Effect, Estimate, Float, Shape, said
from cellwatt_plugins.mismatch.findings import Parameter
from cellwatt_plugins.mismatch.regression import Prior
from cellwatt_plugins.mismatch.states import States
from cellwatt_plugins.robot.description import RobotDescription


class LinkInertialError(Effect):
    """Errors of the ten inertial parameters of the link that a joint moves."""

    name = "link_inertial_error"
    loads = True
    most = 2.5
    confusions = (
        Confusion("payload", "weigh with the tool off, then on"),
        Confusion("torque_gain", "compare with the supply's power at constant speed"),
    )

    def sensible(self, coefficients: Float, robot: RobotDescription, joint: int | None) -> bool:
        # More on the last link looks the same as a payload in every motion, and a payload is what changes in a cell.
        return joint != len(robot.joints) - 1 or bool(coefficients[0] < 0)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        first = 10 * (joint or 0)
        return run.regressor[:, :, first : first + 10]

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        own = runs[0].body.parameters()[10 * (joint or 0) :][:10]
        mass, centre = max(own[0], 0.1), float(np.linalg.norm(own[1:4])) / max(own[0], 0.1)
        turn = float(np.max(np.abs(own[[4, 6, 9]])))
        deviations = [0.4 * mass, *(3 * [0.4 * mass * centre + 0.03 * mass]), *(6 * [0.4 * turn + 1e-4 * mass])]
        return Prior.spread(np.array(deviations))

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        names = ("mass", "moment_x", "moment_y", "moment_z")
        units = ("kg", "kg*m", "kg*m", "kg*m")
        return {n: estimate.coefficient(i, u) for i, (n, u) in enumerate(zip(names, units, strict=True))}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        moment = np.array([parameters[f"moment_{axis}"].value for axis in "xyz"])
        return (
            f"The link moved by {who.lower()} is well off its description: its mass by {said(parameters['mass'])}, "
            f"its first moment by ({moment[0]:.3g}, {moment[1]:.3g}, {moment[2]:.3g}) kg m."
        )
