"""A dead zone between motor and link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from cellwatt.batch import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.compliance.two_mass import coupled, hanging, swinging, with_gap, with_others
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Relations, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST
from cellwatt_plugins.robot.regression import Prior

GAPS = tuple(float(g) for g in np.geomspace(0.001, 0.04, 14))
"""rad that are tried."""
FREQUENCIES = (8.0, 14.0, 25.0)
"""Hz of the link on the closed gear that are tried."""
DAMPINGS = (0.03, 0.2)


class Backlash(Effect):
    """A spring with a dead zone; the link hits its flanks when the load turns over. See ``two_mass``."""

    name = "backlash"
    depends_on = "load"
    form = Form(sample_by_sample=True)
    acceptance = Acceptance(least_rate=FAST, above=0.05)
    """Rebounds that are not followed make the coefficient small; less follows none at all."""
    relations = Relations(family="two_mass")
    uncertainty = Uncertainty({"gap": 0.15})
    """Rebounds in the gap are not followed one by one."""
    confusions = (
        Confusion("joint_elasticity", "reverse slowly at zero load, and tap the link"),
        Confusion("presliding_hysteresis", "reverse slowly where gravity loads the joint: a gap then stays closed"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        loads = np.concatenate([run.load[:, joint] for run in runs])
        inertia = swinging(runs, joint or 0)
        if not inertia or np.all(loads > 0) or np.all(loads < 0):
            return []
        return [
            (gap, float(inertia * (2 * np.pi * f) ** 2), float(4 * np.pi * share * inertia * f))
            for gap, f, share in product(GAPS, FREQUENCIES, DAMPINGS)
        ]

    def grid(self, run: States, joint: int | None, shapes: Sequence[Shape]) -> Sequence[Float]:
        table = np.array(shapes)
        found = with_gap(run, joint or 0, table[:, 1], table[:, 0], table[:, 2])
        return [found[:, i : i + 1] for i in range(len(shapes))]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        own, at = self.grid(run, joint, [shape])[0][:, 0], joint or 0
        pressed = run.load[:, at] + own
        twist = pressed / shape[1] + 0.5 * shape[0] * np.sign(pressed)
        return np.concatenate([with_others(run, at, own), hanging(run, at, twist)], axis=2)

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        if columns.ndim == 2:
            return super().prior(runs, joint, columns, size)
        return coupled(super().prior(runs, joint, columns[:, joint or 0, :1], size))

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.5 * shape[0], 2 * shape[0]), (0.3 * shape[1], 3 * shape[1]), (0.2 * shape[2], 5 * shape[2])]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {
            "gap": estimate.shaped(0, "rad"),
            "stiffness": estimate.shaped(1, "N*m/rad"),
            "damping": estimate.shaped(2, "N*m*s/rad"),
        }

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return (
            f"{who} has a play of about {1000 * parameters['gap'].value:.2g} mrad between motor and link, "
            "felt when its load turns over: backlash is missing."
        )
