"""A drive's position loop that is stiffer or softer than the simulation's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

LIKELY = 0.3
"""Prior standard deviation of a gain that is wrong, as a share."""
LEAST = 0.06
"""Smallest share by which a gain is wrong: three times the error of a correct gain."""


class DriveGain(Effect):
    """The drive's torque is (1 + gain) · stiffness · error, so that the error and the motion imply different torques.

    The motion shows the torque that moves the arm without the noise of the error: the law's torque is that torque, plus
    a share of the position loop's. The share is 1 / (1 + gain) - 1.
    """

    name = "drive_gain"
    acts_on = "drive"
    depends_on = "fitted torque"
    relations = Relations(plainer=5.0)
    confusions = (
        Confusion("rotor_inertia", "hold the arm still in poses of different weight: a soft loop sags"),
        Confusion("spring_load", "hold the joint at several positions: a spring pulls towards one of them"),
    )

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        at = joint or 0
        return np.asarray(run.torque[:, [at]] + run.servos.servo.damping[at] * run.qd[:, [at]])

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        return Prior.spread(np.full(columns.shape[-1], LIKELY))

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        """True if the loop is possible, and clearly different from the file's."""
        return bool(-0.8 < coefficients[0] < 4.0 and abs(coefficients[0]) > LEAST)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        share = estimate.coefficient(0, "")
        return {"gain": Parameter(1 / (1 + share.value) - 1, share.std / (1 + share.value) ** 2, "")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        gain = parameters["gain"]
        way = "stiffer" if gain.value > 0 else "softer"
        return (
            f"The position loop of {who.lower()} is {100 * abs(gain.value):.1f} ± {100 * gain.std:.1f} % {way} than "
            "the simulation's."
        )
