"""Mass, centre of mass or inertia of a link, clearly different from the description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.pseudo_inertia import ENTRIES
from cellwatt_plugins.robot.regression import Prior

OFF = 0.4
"""Standard deviation of a link's mass, of its inertia and of its centre's distance, as a share."""
NEAR = 0.03
"""m added to the distance of the centre of mass, as it may be wrong for a link that has it on its axis."""
BESIDES = 0.02
"""Share of each parameter that may be wrong independently."""


class LinkInertialError(Effect):
    """Errors of the ten inertial parameters of the link that a joint moves."""

    name = "link_inertial_error"
    acts_on = "links"
    acceptance = Acceptance(prior_deviations=2.5, common=True)
    confusions = (
        Confusion("payload", "weigh with the tool off, then on"),
        Confusion("torque_gain", "compare with the supply's power at constant speed"),
    )
    coefficients_are = (("mass", "kg"), ("moment_x", "kg*m"), ("moment_y", "kg*m"), ("moment_z", "kg*m"))
    sentence = (
        "The link moved by {joint} differs from its description: its mass by {mass}, "
        "its first moment by ({moment_x:.3g}, {moment_y:.3g}, {moment_z:.3g}) kg m."
    )

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        # In every motion, more mass on the last link equals a payload, and the payload is what changes in a cell.
        return joint != len(robot.joints) - 1 or bool(coefficients[0] < 0)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        first = 10 * (joint or 0)
        return run.regressor[:, :, first : first + 10]

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """Typical errors of a link: all of it scaled, its centre of mass moved, its inertia scaled; little else.

        Ten independent parameters could also stand for the link before or after: the moments of an added mass at this
        link's centre must come with that mass.
        """
        own = runs[0].arm.body.parameters()[10 * (joint or 0) :][:10]
        mass = max(float(own[0]), 0.1)
        centre = own[1:4] / mass
        reach = float(np.linalg.norm(centre)) + NEAR
        moves = [_moved(mass, centre, step) for step in OFF * reach * np.eye(3)]
        swelling = np.concatenate([np.zeros(4), own[4:] - mass * _around(centre, centre)])
        ways = np.array([OFF * own, *moves, OFF * swelling])
        turn = float(np.max(np.abs(own[[4, 6, 9]])))
        besides = [mass, *(3 * [mass * reach]), *(6 * [2 * turn + 1e-3 * mass])]
        return Prior(np.zeros(10), ways.T @ ways + np.diag(np.square(BESIDES * np.array(besides))))


def _moved(mass: float, centre: Float, step: Float) -> Float:
    """Change of ten parameters (mass, first moment, inertia at the joint) when the centre of mass moves by a step."""
    return np.concatenate([[0.0], mass * step, mass * (_around(centre, step) + _around(step, centre))])


def _around(a: Float, b: Float) -> Float:
    """a·b 1 - a bᵀ as xx, xy, yy, xz, yz, zz: the inertia of a unit mass, for a = b."""
    return np.asarray(((a @ b) * np.eye(3) - np.outer(a, b))[ENTRIES])
