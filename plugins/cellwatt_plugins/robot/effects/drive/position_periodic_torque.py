"""Torque that repeats over a turn: gear, cogging, bearing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States

LEAST = 3
"""Fewest cycles per turn: fewer are gravity or a spring."""
FEW, WHOLE = 6, 0.2
"""Cycles per turn below which they belong to the joint, not to its motor: only whole numbers, within ``WHOLE``, close
over a turn. What else looks like them is an error of the links."""
MOST = 60
"""Most cycles per turn that are tried, beside those of the gear."""
SECOND = 2.0
"""Cycles of the second harmonic per cycle of the first."""
APART = 1.5
"""Periods over the joint's range of motion by which two ripples differ clearly."""


class PositionPeriodicTorque(Effect):
    """A sin(n q + phase), and its second harmonic if the shape has one: (n,) or (n, 2)."""

    name = "position_periodic_torque"
    relations = Relations(along="position")
    acceptance = Acceptance(inside_bounds=True)
    confusions = (
        Confusion("external_contact", "repeat the same path: a contact does not repeat"),
        Confusion("link_inertial_error", "move the joint over more than a turn of the ripple"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        span = max(float(np.ptp(run.q[:, joint])) for run in runs)
        gear = runs[0].robot.joints[joint or 0].gear_ratio
        tried = {float(n) for n in range(LEAST, MOST + 1)} | {gear, 2 * gear}
        return [(n,) for n in sorted(tried) if n >= LEAST and n * span > 2 * np.pi and _seen(runs, joint, n)]

    def fuller(self, runs: Sequence[States], joint: int | None, shape: Shape) -> Sequence[Shape]:
        first = [(n, SECOND) for n in (shape[0], shape[0] / SECOND) if n >= LEAST and _seen(runs, joint, SECOND * n)]
        return first if len(shape) == 1 else []

    def unlike(self, runs: Sequence[States], joint: int | None, shape: Shape) -> Sequence[Shape]:
        span = max(float(np.ptp(run.q[:, joint])) for run in runs)
        apart = APART * 2 * np.pi / span
        others = np.arange(1.0, max(shape[0] + 3 * apart, 12.0), max(0.5, apart / 3))
        return [(float(n), *shape[1:]) for n in others if abs(n - shape[0]) > apart]

    def closed(self, shape: Shape) -> bool:
        return shape[0] > FEW or abs(shape[0] - round(shape[0])) < WHOLE

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        angles = [shape[0] * order * run.q[:, joint] for order in (1.0, *shape[1:])]
        return np.column_stack([wave(angle) for angle in angles for wave in (np.sin, np.cos)])

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        first = (LEAST - 0.5, 2.0 * MOST) if shape[0] < MOST else (shape[0] - 0.5, shape[0] + 0.5)
        return [first, *((order, order) for order in shape[1:])]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        a, b = estimate.coefficients[:2]
        to_phase = np.array([-b, a]) / np.square(np.hypot(a, b))
        out = {
            "amplitude": _amplitude(estimate, 0),
            "cycles": estimate.shaped(0, "1/turn"),
            "phase": Parameter(
                float(np.arctan2(b, a)), float(np.sqrt(to_phase @ estimate.covariance[:2, :2] @ to_phase)), "rad"
            ),
        }
        return out if len(estimate.shape) == 1 else out | {"second_amplitude": _amplitude(estimate, 2)}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        second = parameters.get("second_amplitude")
        more = "" if second is None else f", and of {second} twice as often"
        return (
            f"{who} has a ripple of {parameters['amplitude']}, {parameters['cycles'].value:.4g} times per turn"
            f"{more}: a position-periodic torque (gear, cogging or bearing) is missing."
        )


def _amplitude(estimate: Estimate, first: int) -> Parameter:
    own = slice(first, first + 2)
    size = float(np.hypot(*estimate.coefficients[own]))
    slope = estimate.coefficients[own] / size
    return Parameter(size, float(np.sqrt(slope @ estimate.covariance[own, own] @ slope)), "N*m")


def _seen(runs: Sequence[States], joint: int | None, cycles: float) -> bool:
    """True if the sampling resolves the ripple during most of the motion."""
    speeds = np.concatenate([np.abs(run.qd[:, joint]) for run in runs])
    moving = speeds[speeds > 0.02]
    return bool(len(moving)) and cycles * float(np.median(moving)) * runs[0].step < 1.5
