"""Friction that builds up over a displacement after a reversal instead of at once (Dahl)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Relations, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST

WAYS = np.geomspace(1.5e-4, 0.3, 16)
"""Displacements in rad that are tried."""

RESOLVED = 6.0
"""Smallest resolved displacement, in standard deviations of the encoder's noise."""

RESOLVED_SPEED = 3.0
"""Smallest resolved speed, in standard deviations of the velocity."""
BLIND, SAMPLES = 0.02, 2.0
"""s after a reversal, or samples if longer, in which smoothed encoders do not show how friction builds up."""


SLOW = 0.0
"""In place of the displacement: friction builds up within a speed instead."""
SPEEDS = (0.015, 0.025, 0.04, 0.07, 0.12, 0.2)
"""Speeds in rad/s that are tried."""


class PreslidingHysteresis(Effect):
    """F (z - sign(w)), dz/dq = (1 - z sign(w)) / way: Dahl, Solid Friction Damping of Mechanical Vibrations (1976).

    Or z = tanh(w / speed): in some gears friction builds up with the speed, slowly, as the film of lubricant does.
    """

    name = "presliding_hysteresis"
    of_motor = True
    acts_on = "friction"
    form = Form(reverses=True)
    relations = Relations(beats=("coulomb_friction",))
    acceptance = Acceptance(least_rate=FAST, above=0.0, inside_bounds=True)
    uncertainty = Uncertainty({"displacement": 0.05})
    """How friction builds up after a reversal differs from gear to gear."""
    confusions = (
        Confusion("stribeck_friction", "reverse slowly at one place: presliding depends on the way since reversal"),
        Confusion("backlash", "reverse slowly at zero load"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        fastest = max(float(np.max(np.abs(run.qd[:, joint]))) for run in runs)
        return [*((float(way),) for way in WAYS), *((SLOW, speed) for speed in SPEEDS if speed < 0.5 * fastest)]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        axis = joint or 0
        if shape[0] == SLOW:
            return shape[1] > RESOLVED_SPEED * max(float(np.median(run.moved.velocity_spread[:, axis])) for run in runs)
        least = RESOLVED * max(float(run.moved.resolution[axis]) for run in runs)
        if any(run.unplanned for run in runs):
            # Motion between two samples after a reversal cannot be distinguished from the reversal itself.
            moving = np.concatenate([run.qdd[run.moving, axis] for run in runs])
            hasty = float(np.sqrt(np.mean(np.square(moving)))) if len(moving) else 0.0
            least = max(least, 0.5 * hasty * max(BLIND, SAMPLES * runs[0].step) ** 2)
        return shape[0] > least

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        if shape[0] == SLOW:
            return (np.tanh(run.qd[:, joint] / shape[1]) - run.sign[:, joint])[:, None]
        return (dahl_state(run.q[:, joint], shape[0]) - run.sign[:, joint])[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(SLOW, SLOW), (0.01, 0.5)] if shape[0] == SLOW else [(5e-5, 0.6)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        if estimate.shape[0] == SLOW:
            return {"force": estimate.coefficient(0, "N*m"), "velocity": estimate.shaped(1, "rad/s")}
        return {"force": estimate.coefficient(0, "N*m"), "displacement": estimate.shaped(0, "rad")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        over = (
            f"over {parameters['displacement'].value:.2g} rad"
            if "displacement" in parameters
            else f"until about {parameters['velocity'].value:.2g} rad/s"
        )
        return (
            f"Friction of {who.lower()} ({parameters['force']}) builds up {over} after each reversal, and not at "
            "once: presliding hysteresis is missing."
        )


def dahl_state(position: Float, way: float) -> Float:
    """State z (N,) from -1 to 1 of a bristle that reverses within ``way`` rad, from rest."""
    moves = np.diff(position)
    decay = np.exp(-np.abs(moves) / way)
    pull = np.sign(moves) * (1 - decay)
    out = np.empty(len(position))
    state = out[0] = 0.0
    for i, (keep, add) in enumerate(zip(decay.tolist(), pull.tolist(), strict=True), start=1):
        state = keep * state + add
        out[i] = state
    return out
