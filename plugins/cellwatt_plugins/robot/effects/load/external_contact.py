"""A push on a joint at one time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST

WIDTHS = (0.06, 0.12, 0.25, 0.45)
"""Widths in s (standard deviation of the push over time) that are tried."""
STOPPED, NEAR = 0.02, 0.3
"""rad/s and s: a joint at such a velocity at most, or so short a time from it, is near a stop."""
BLOW = 0.045
"""Width in s of a collision, tried only where times near stops are excluded anyway."""
SHORTEST = 0.05
"""Width in s below which a push may be a stop."""
OF_FRICTION = 0.5
"""Share of Coulomb friction that a push must exceed."""
PEAKS = 2
"""Number of times tried per run and width."""


class ExternalContact(Effect):
    """torque · exp(-(t - time)²/(2 width²)) in one run. Shape: run, time, width."""

    name = "external_contact"
    depends_on = "residual"
    form = Form(intermittent=True)
    acceptance = Acceptance(least_rate=FAST, exact_times=True, inside_bounds=True)
    uncertainty = Uncertainty(inherited={"torque": 0.03, "width": 0.08})
    confusions = (
        Confusion("unknown", "repeat the same program: a contact does not repeat"),
        Confusion("payload_change", "look at all joints that gravity loads: a payload shows in several"),
    )
    coefficients_are = (("torque", "N*m"),)
    shape_is = (("", ""), ("time", "s"), ("width", "s"))
    sentence = "{who} was pushed once with {torque} at {time:.2f} s: an external contact."

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        """True if the push exceeds a share of the friction: a smaller one is how friction reverses at a stop."""
        return abs(float(coefficients[0])) > OF_FRICTION * robot.joints[joint or 0].coulomb_friction

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        return [
            (float(run.index), float(run.time[sample]), width)
            for run, course in zip(runs, residual, strict=True)
            for width in ((BLOW, *WIDTHS) if run.unplanned else WIDTHS)
            for sample in peaks(np.where(_turns(run, joint or 0), 0.0, course[:, joint]), run.step, width)
        ]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        """True if the push was at a recorded time."""
        return any(run.time[0] < shape[1] < run.time[-1] for run in runs if run.index == round(shape[0]))

    def charge(self, runs: Sequence[States], shape: Shape) -> float:
        return float(np.log(sum(float(run.time[-1] - run.time[0]) for run in runs) / shape[2]))

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        if run.index != int(shape[0]):
            return np.zeros((len(run.time), 1))
        return np.exp(-0.5 * np.square((run.time - shape[1]) / shape[2]))[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        run, time, width = shape
        least = SHORTEST if width >= SHORTEST else 0.5 * BLOW
        return [(run, run), (time - 2 * width, time + 2 * width), (least, 0.6)]


def _turns(run: States, joint: int) -> NDArray[np.bool_]:
    """Samples (N,) near a stop of the joint, if the velocity is differentiated: friction looks like a push there."""
    if not run.unplanned:
        return np.zeros(len(run.time), np.bool_)
    slow = np.abs(run.qd[:, joint]) < STOPPED
    return np.asarray(maximum_filter1d(slow, 2 * round(NEAR / run.step) + 1), np.bool_)


def peaks(residual: Float, step: float, width: float) -> list[int]:
    """Samples where a bump of this width fits best, greatest first, not overlapping; none if it is longer than the
    run."""
    half = max(1, round(3 * width / step))
    if 2 * half + 1 > len(residual):
        return []
    bump = np.exp(-0.5 * np.square(np.arange(-half, half + 1) * step / width))
    match = np.abs(np.convolve(residual, bump, mode="same")) / np.sqrt(np.sum(bump**2))
    out = []
    for _ in range(PEAKS):
        top = int(np.argmax(match))
        out.append(top)
        match[max(0, top - 2 * half) : top + 2 * half + 1] = 0
    return out
