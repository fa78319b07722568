"""Motor and link as two masses on a spring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.compliance.two_mass import TwoMass, elastic, swinging
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Uncertainty
from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST

FREQUENCIES = np.geomspace(1.5, 40.0, 110)
"""Frequencies in Hz, of the link on its spring, that are tried."""
DAMPINGS = (0.003, 0.012, 0.05, 0.15)
"""Damping ratios that are tried."""
MOVES_ALONG, AT_REST = 0.0, 1.0


class JointElasticity(TwoMass):
    """Stiffness and damping between motor and link; see ``two_mass``."""

    name = "joint_elasticity"
    form = Form(to_scale=True, sample_by_sample=True)
    acceptance = Acceptance(least_rate=FAST, exact_times=True)
    uncertainty = Uncertainty({"stiffness": 0.03, "damping": 0.1})
    """The motion shows only stiffness / inertia: stiffness is as uncertain as the links' inertia."""
    confusions = (
        Confusion("backlash", "tap the link, and reverse slowly at zero load: a spring rings, a gap clacks"),
        Confusion("time_delay", "move with and without jerk: a spring rings on"),
    )
    shape_is = (("stiffness", "N*m/rad"), ("damping", "N*m*s/rad"))
    refined = (0.5, 2.0), (0.1, 10.0), (1.0, 1.0)
    sentence = "The link of {joint} swings on a gear of {stiffness:.3g} Nm/rad: joint elasticity is missing."

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        inertia = swinging(runs, joint or 0)
        if not inertia:
            return []
        turns = 2 * np.pi * FREQUENCIES[0.45 / runs[0].step > FREQUENCIES]
        moves = any(abs(run.qd[0, joint]) > 0.02 for run in runs)
        starts = (MOVES_ALONG, AT_REST) if moves else (MOVES_ALONG,)
        return [
            (float(inertia * w**2), float(2 * share * inertia * w), start)
            for start in starts
            for share in DAMPINGS
            for w in turns
        ]

    def added(self, run: States, joint: int, shapes: Float) -> Float:
        return elastic(run, joint, shapes[:, 0], shapes[:, 1], shapes[:, 2])

    def twist(self, run: States, joint: int, own: Float, shape: Shape) -> Float:
        return np.asarray((run.rigid[:, joint] + own) / shape[0])
