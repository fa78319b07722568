"""A base that is not level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States


class GravityTilt(Effect):
    """Gravity turned about the two axes of the base that lie nearest to level: x (roll), y (pitch), z (yaw)."""

    name = "gravity_tilt"
    acts_on = "links"
    whole_arm = True
    acceptance = Acceptance(several_channels=True)
    uncertainty = Uncertainty({"roll": 0.015, "pitch": 0.015, "yaw": 0.015})
    """The tilted weight is as uncertain as the links."""
    plausible = (lambda c: float(np.hypot(c[0], c[1]))), 0.0, 0.18
    """A base that leans by more than 10 degrees was mounted so on purpose."""
    confusions = (
        Confusion("payload", "turn joint 1 about its vertical axis: a tilt loads it, a payload does not"),
        Confusion("link_inertial_error", "turn joint 1 about its vertical axis"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        # The shape holds the axes: after the fit they cannot be known otherwise.
        return [tuple(float(axis) for axis in level(runs[0].arm.body.gravity_field))]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        body = run.arm.body
        ways = [body.with_gravity(way).gravity(run.q) for way in turned(body.gravity_field, shape)]
        return np.stack(ways, axis=2)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {AXES[int(axis)]: estimate.coefficient(i, "rad") for i, axis in enumerate(estimate.shape)}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        leans = " and ".join(f"{np.degrees(each.value):.1f}° in {name}" for name, each in parameters.items())
        return f"The base is not level: it leans {leans}."


AXES = ("roll", "pitch", "yaw")


def level(field: Float) -> list[int]:
    """The two axes (0-based) of the base that lie nearest to level where gravity is ``field`` (3,)."""
    return sorted(np.argsort(np.abs(field), kind="stable")[:2].tolist())


def turned(field: Float, axes: Shape) -> Float:
    """Changes (2, 3) of gravity ``field`` (3,) in the base's frame, for 1 rad about each of the base's ``axes``."""
    return np.stack([np.cross(field, np.eye(3)[int(axis)]) for axis in axes or (0.0, 1.0)])
