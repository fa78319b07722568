"""The owner's preparation: link parameters, rotor inertia and friction of an arm from its recordings.

Linear identification model (Khalil, Dombre: Modeling, Identification and Control of Robots, ch. 12) with a prior from
the URDF. Columns and torque pass the same zero-phase low-pass ("parallel filtering"): filtered torque against
unfiltered friction would look like hysteresis at every reversal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from cellwatt_plugins.robot import Body
from cellwatt_plugins.robot.motion import direction
from real.describe import Drives, Link
from real.recording import Float, Recording

RATE = 100.0
"""Hz of the grid that columns are made on."""
MOTION_BAND = 12.0
"""Hz kept of the encoders before they are differentiated."""
BAND = 8.0
"""Hz kept of columns and torque."""
EVERY = 4
"""Every so many samples of the filtered columns is kept."""
REACH = 0.03
"""m: how far a link's centre of mass may be from where the URDF has it."""
GYRATION = 0.01
"""m: radius of gyration by which a link's inertia may be off; more is left to the rotors, so that it stays positive."""
LEAST_GYRATION = 0.02
"""m: no link is smaller."""
MASS_SPREAD = 0.3
"""Share of a link's mass by which the URDF may be off."""
ROUNDS = 4
"""Of weighing the joints by their residuals."""


@dataclass(frozen=True)
class Identified:
    """An arm as its recordings show it, with the residual (n,) Nm of the fit."""

    links: tuple[Link, ...]
    drives: Drives
    residual: Float


@dataclass(frozen=True)
class Prepared:
    """A recording on an even grid, low-passed: N samples, n joints, p columns."""

    columns: Float
    """(N, n, p): 10 n link parameters, then n each of rotor, Coulomb, viscous, offset."""
    effort: Float
    """(N, n) Nm with gains as first given."""

    @staticmethod
    def of(recording: Recording, body: Body, gain: Float) -> Prepared:
        """Resting ends are left out."""
        grid, q, qd, qdd = motion_of(recording)
        own = [diagonal(values) for values in (qdd, direction(qd), qd, np.ones_like(qd))]
        columns = np.concatenate([body.regressor(q, qd, qdd), *own], axis=2)
        moving = recording.moving()
        kept = np.flatnonzero((grid >= moving.time[0]) & (grid <= moving.time[-1]))[::EVERY]
        effort = resampled(grid, recording.time, recording.effort(gain))
        return Prepared(low_pass(columns, BAND)[kept], low_pass(effort, BAND)[kept])


def prepared(recordings: Sequence[Recording], body: Body, gain: Float) -> tuple[Float, Float, list[int]]:
    """Columns and effort of all recordings, one after the other, and how many samples each has."""
    runs = [Prepared.of(recording, body, gain) for recording in recordings]
    columns = np.concatenate([run.columns for run in runs])
    effort = np.concatenate([run.effort for run in runs])
    return columns, effort, [len(run.effort) for run in runs]


def with_payload(
    without: Sequence[Recording], loaded: Sequence[Recording], body: Body, gain: Float
) -> tuple[Float, Float, Float]:
    """Columns and effort of all recordings, and columns (N, n, 10) of what ``loaded`` ones carry at the last link."""
    columns, effort, counts = prepared([*without, *loaded], body, gain)
    carried = np.arange(len(effort)) >= sum(counts[: len(without)])
    return columns, effort, columns[:, :, 10 * (body.joints - 1) : 10 * body.joints] * carried[:, None, None]


def identify(recordings: Sequence[Recording], body: Body, gain: Float, gear: float) -> Identified:
    """Least squares over all recordings, joints weighed by their residuals, links held to the URDF where unseen."""
    columns, effort, _ = prepared(recordings, body, gain)
    joints = body.joints
    believed = np.concatenate([body.parameters(), np.zeros(4 * joints)])
    solved, residual = solve(columns, effort, believed, spread(body))
    rotor, coulomb, viscous = np.maximum(solved[10 * joints : 13 * joints].reshape(3, joints), 0.0)
    return Identified(links_of(solved[: 10 * joints]), Drives(coulomb, viscous, rotor, gain, gear), residual)


def carried_mass(without: Sequence[Recording], loaded: Sequence[Recording], body: Body, gain: Float) -> float:
    """Mass kg that a plain least-squares fit with these gains gives ``loaded`` recordings beyond those ``without``."""
    columns, effort, payload = with_payload(without, loaded, body, gain)
    joints = body.joints
    believed = np.concatenate([body.parameters(), np.zeros(4 * joints + 10)])
    free = np.concatenate([spread(body), np.full(10, 10.0)])
    solved, _ = solve(np.concatenate([columns, payload], axis=2), effort, believed, free)
    return float(solved[14 * joints])


def solve(columns: Float, effort: Float, believed: Float, believed_spread: Float) -> tuple[Float, Float]:
    """Parameters (p,) of columns (N, n, p) with a normal prior, and the residual's rms (n,)."""
    weight = np.ones(effort.shape[1])
    solved = believed
    for _ in range(ROUNDS):
        weighed = (columns * weight[:, None]).reshape(-1, columns.shape[2]) * believed_spread
        target = ((effort - columns @ believed) * weight).ravel()
        normal = weighed.T @ weighed + np.eye(len(believed))
        solved = believed + believed_spread * np.linalg.solve(normal, weighed.T @ target)
        weight = 1 / np.sqrt(np.mean(np.square(effort - columns @ solved), axis=0))
    return solved, 1 / weight


def spread(body: Body) -> Float:
    """Standard deviations (14 n,) of the prior: link parameters near the URDF's, drives as good as free."""
    mass = body.parameters()[::10]
    arm = float(mass.mean())
    own = np.array([MASS_SPREAD, REACH, REACH, REACH, *(6 * [GYRATION**2])])
    return np.concatenate([np.outer(np.maximum(mass, 0.3 * arm), own).ravel(), np.full(4 * len(mass), 100.0)])


def links_of(parameters: Float) -> tuple[Link, ...]:
    """Links of inertial parameters (10 n,) about the joints' origins, their inertia made that of a real body."""
    links = []
    for mass, mx, my, mz, xx, xy, yy, xz, yz, zz in parameters.reshape(-1, 10):
        x, y, z = mx / mass, my / mass, mz / mass
        about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        centre = np.array([x, y, z])
        size, axes = np.linalg.eigh(about_origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)))
        inertia = (axes * np.maximum(size, mass * LEAST_GYRATION**2)) @ axes.T
        (a, b, c), (_, d, e), (_, _, f) = inertia.tolist()
        links.append(Link(mass, (x, y, z), (a, b, c, d, e, f)))
    return tuple(links)


def motion_of(recording: Recording) -> tuple[Float, Float, Float, Float]:
    """Time (N,) s of an even grid, and position, velocity and acceleration (N, n) on it, low-passed."""
    time, measured = even_time(recording), (recording.position, recording.velocity)
    q, qd = (low_pass(resampled(time, recording.time, values), MOTION_BAND) for values in measured)
    return time, q, qd, np.gradient(qd, 1 / RATE, axis=0)


def even_time(recording: Recording) -> Float:
    """The grid (N,) s that a recording is compared on."""
    return np.arange(recording.time[0], recording.time[-1], 1 / RATE)


def resampled(time: Float, at: Float, values: Float) -> Float:
    """Values (M, n) known at ``at`` (M,) on the grid ``time`` (N,)."""
    return np.column_stack([np.interp(time, at, one) for one in values.T])


def low_pass(values: Float, band: float) -> Float:
    """Zero-phase Butterworth of (N, …) values on the grid."""
    return np.asarray(sosfiltfilt(butter(4, band, fs=RATE, output="sos"), values, axis=0))


def diagonal(values: Float) -> Float:
    """Columns (N, n, n) that act on their own joint only."""
    return values[:, :, None] * np.eye(values.shape[1])
