"""Motor and link as two masses: the torque at the motor beyond that of a rigid joint.

The encoder is at the motor, whose motion is given. With δ the twist, s(δ, dδ/dt) the torque through the spring and u
the torque that the link needs for the motor's motion, the link obeys M d²δ/dt² + s = u. The motor feels s instead of
u. Spong, Modeling and Control of Elastic Joint Robots (1987), with the motor's motion as the input.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Relations
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

MOST_STEP = 0.2
"""Largest step of the numerical integration, in radians of the natural frequency."""
CHUNK = 2000
"""Number of samples whose transition matrices are computed at a time."""
OTHERS = (0.5, 0.5)
"""Share of a link's oscillation that the other joints feel, and its standard deviation."""
LEAST_INERTIA = 1e-6
"""Smallest inertia in kg m² of a link that can oscillate; a description may omit the last link's."""
BEFORE, WINDOW = 0.1, 1.5
"""Times in s: a gap is simulated from ``BEFORE`` a reversal of the load, until the link rests on its other flank."""


class TwoMass(Effect):
    """A link that moves against its motor: the torques that it adds at its joint, at the others, and by its weight."""

    relations = Relations(family="two_mass")

    @abstractmethod
    def added(self, run: States, joint: int, shapes: Float) -> Float:
        """Torque (N, P) Nm that links of P ``shapes`` (P, k) add at their own joint."""

    @abstractmethod
    def twist(self, run: States, joint: int, own: Float, shape: Shape) -> Float:
        """Angle (N,) rad by which the link lags its motor; ``own`` (N,) Nm is the torque that the link adds."""

    def grid(self, run: States, joint: int | None, shapes: Sequence[Shape]) -> Sequence[Float]:
        return np.split(self.added(run, joint or 0, np.array(shapes)), len(shapes), axis=1)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        own, at = self.grid(run, joint, [shape])[0][:, 0], joint or 0
        twist = self.twist(run, at, own, shape)
        return np.concatenate([with_others(run, at, own), hanging(run, at, twist)], axis=2)

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """Prior of a link's own column, and of the columns derived from it, whose share depends on the other drives."""
        if columns.ndim == 2:
            return super().prior(runs, joint, columns, size)
        own = super().prior(runs, joint, columns[:, joint or 0, :1], size)
        covariance = np.diag([*np.diag(own.covariance), OTHERS[1] ** 2, OTHERS[1] ** 2])
        return Prior(np.array([*own.mean, OTHERS[0], OTHERS[0]]), covariance)


def swinging(runs: Sequence[States], joint: int) -> float:
    """Mean inertia in kg m² of the link on ``joint`` (0-based); 0 if at any sample it is too small to oscillate."""
    inertia = np.concatenate([run.own_inertia[:, joint] for run in runs])
    return float(np.mean(inertia)) if np.min(inertia) > LEAST_INERTIA else 0.0


def elastic(run: States, joint: int, stiffness: Float, damping: Float, at_rest: Float) -> Float:
    """Torque (N, P) Nm that a linear spring adds, for P springs: ``stiffness`` Nm/rad, ``damping`` Nm s/rad.

    ``at_rest`` is 1 if the link stood still at the start of the run although the motor moved, else 0: the link moved
    along. The solution is exact for inertia and torque held over a sample.
    """
    inertia = run.own_inertia[:, joint]
    inertia = 0.5 * (inertia + np.append(inertia[1:], inertia[-1]))
    need = run.rigid[:, joint]
    out = np.empty((len(need), len(stiffness)))
    twist, speed = need[0] / stiffness, at_rest * run.qd[0, joint]
    out[0] = damping * speed
    for first in range(0, len(need) - 1, CHUNK):
        last = min(first + CHUNK, len(need) - 1)
        keep, lead, push, slow = _transition(inertia[first:last, None], stiffness, damping, run.step)
        for i in range(first, last):
            settled = 0.5 * (need[i] + need[i + 1]) / stiffness
            k, off = i - first, twist - settled
            twist, speed = settled + keep[k] * off + lead[k] * speed, push[k] * off + slow[k] * speed
            out[i + 1] = stiffness * twist + damping * speed - need[i + 1]
    return out


def with_others(run: States, joint: int, own: Float) -> Float:
    """Columns (N, n, 2): torque ``own`` (N,) Nm of an oscillating link at its joint, and its effect at the others.

    The link's acceleration differs from the motor's by own / M_jj; joint k needs M_kj of that.
    """
    out = np.zeros((*run.q.shape, 2))
    mass = run.arm.body.mass_matrix(run.q)[:, :, joint]
    out[:, :, 1] = mass * (own / mass[:, joint])[:, None]
    out[:, joint, 0], out[:, joint, 1] = own, 0.0
    return out


def hanging(run: States, joint: int, twist: Float) -> Float:
    """Column (N, n, 1): change of the gravity torques as a link lags its motor by ``twist`` (N,) rad."""
    return np.asarray(-twist[:, None, None] * run.arm.body.gravity_slope(run.q)[:, :, joint, None])


def _transition(inertia: Float, stiffness: Float, damping: Float, step: float) -> tuple[Float, Float, Float, Float]:
    """Entries (N, P) of the matrix that carries twist and speed over one step of a damped oscillator."""
    decay, square = damping / (2 * inertia), stiffness / inertia
    beat = np.sqrt(np.maximum(np.abs(square - decay**2), 1e-9))
    fade = np.exp(-decay * step)
    cosine, sine = np.cos(beat * step) * fade, np.sin(beat * step) / beat * fade
    if np.any(creeps := decay**2 > square):
        fast, slow = (0.5 * np.exp((way * beat - decay) * step) for way in (-1, 1))
        cosine, sine = np.where(creeps, slow + fast, cosine), np.where(creeps, (slow - fast) / beat, sine)
    return cosine + decay * sine, sine, -square * sine, cosine - decay * sine


def with_gap(run: States, joint: int, stiffness: Float, gap: Float, damping: Float) -> Float:
    """Torque (N, P) Nm that a spring with a dead zone of ``gap`` rad (whole width) adds, for P such springs.

    Away from reversals of the load the gear rests on one flank and adds no torque.
    """
    need, inertia = run.load[:, joint], run.own_inertia[:, joint]
    out = np.zeros((len(need), len(stiffness)))
    length = max(2, round(WINDOW / run.step))
    starts = _turnovers(need, max(1, round(BEFORE / run.step)), length)
    if not len(starts):
        return out
    rows = np.minimum(starts[:, None] + np.arange(length), len(need) - 1)
    found = _windows(need[rows], inertia[rows], run.step, (stiffness, gap / 2, damping))
    for start, part in zip(starts, found, strict=True):
        end = min(start + length, len(need))
        out[start:end] = part[: end - start]
    return out


def _turnovers(need: Float, before: int, length: int) -> NDArray[np.intp]:
    """First samples of windows that begin ``before`` a reversal of the load and follow it for half a window or more."""
    out: list[int] = []
    for turn in np.flatnonzero(np.diff(np.sign(need)) != 0):
        if not out or turn >= out[-1] + length // 2:
            out.append(max(0, int(turn) - before))
    return np.array(out, np.intp)


def _windows(need: Float, inertia: Float, step: float, spring: tuple[Float, Float, Float]) -> Float:
    """Torque (W, L, P) added in W windows of L samples with loads and inertias (W, L), simulated side by side."""
    stiffness, half, damping = spring
    parts = max(1, int(np.ceil(float(np.sqrt(np.max(stiffness) / np.min(inertia))) * step / MOST_STEP)))
    small = step / parts
    first = need[:, :1]
    twist = first / stiffness + np.where(first >= 0, half, -half)
    speed = np.zeros_like(twist)
    out = np.zeros((len(need), need.shape[1], len(stiffness)))
    for i in range(need.shape[1] - 1):
        torque, more = need[:, i : i + 1], (need[:, i + 1 : i + 2] - need[:, i : i + 1]) / parts
        for part in range(parts):
            through = _through(twist, speed, stiffness, half, damping)
            speed = speed + small / inertia[:, i : i + 1] * (torque + part * more - through)
            twist = twist + small * speed
        out[:, i + 1] = _through(twist, speed, stiffness, half, damping) - need[:, i + 1 : i + 2]
    return out


def _through(twist: Float, speed: Float, stiffness: Float, half: Float, damping: Float) -> Float:
    pressed = twist - np.minimum(np.maximum(twist, -half), half)
    return np.asarray(stiffness * pressed + damping * speed * (pressed != 0))
