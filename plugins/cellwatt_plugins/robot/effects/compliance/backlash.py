"""A dead zone between motor and link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.compliance.two_mass import TwoMass, swinging, with_gap
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Uncertainty
from cellwatt_plugins.robot.effects.effect import Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST

GAPS = tuple(float(g) for g in np.geomspace(0.001, 0.04, 14))
"""Gaps in rad that are tried."""
FREQUENCIES = (8.0, 14.0, 25.0)
"""Frequencies in Hz, of the link on the closed gear, that are tried."""
DAMPINGS = (0.03, 0.2)


class Backlash(TwoMass):
    """A spring with a dead zone; the link hits its flanks when the load reverses. See ``two_mass``."""

    name = "backlash"
    depends_on = "load"
    form = Form(sample_by_sample=True)
    acceptance = Acceptance(least_rate=FAST, exact_times=True, above=0.05)
    """Rebounds that the model does not follow reduce the coefficient; below this, it follows none."""
    uncertainty = Uncertainty({"gap": 0.15})
    """The model does not follow single rebounds in the gap."""
    confusions = (
        Confusion("joint_elasticity", "reverse slowly at zero load, and tap the link"),
        Confusion("presliding_hysteresis", "reverse slowly where gravity loads the joint: a gap then stays closed"),
    )
    shape_is = (("gap", "rad"), ("stiffness", "N*m/rad"), ("damping", "N*m*s/rad"))
    refined = (0.5, 2.0), (0.3, 3.0), (0.2, 5.0)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        loads = np.concatenate([run.load[:, joint] for run in runs])
        inertia = swinging(runs, joint or 0)
        if not inertia or not np.min(loads) < 0 < np.max(loads):
            return []
        return [
            (gap, float(inertia * (2 * np.pi * f) ** 2), float(4 * np.pi * share * inertia * f))
            for gap, f, share in product(GAPS, FREQUENCIES, DAMPINGS)
        ]

    def added(self, run: States, joint: int, shapes: Float) -> Float:
        return with_gap(run, joint, shapes[:, 1], shapes[:, 0], shapes[:, 2])

    def twist(self, run: States, joint: int, own: Float, shape: Shape) -> Float:
        pressed = run.load[:, joint] + own
        return np.asarray(pressed / shape[1] + 0.5 * shape[0] * np.sign(pressed))

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return (
            f"{who} has a play of about {1000 * parameters['gap'].value:.2g} mrad between motor and link, "
            "which shows when its load reverses: backlash is missing."
        )
