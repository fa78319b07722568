"""Motion as a servo's law needs it: position, velocity and acceleration through one filter, without shrinking any."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

from cellwatt.arrays import Float
from cellwatt_plugins.noise import step_noise
from cellwatt_plugins.robot.motion import Moved, differentiate, expected_sign, from_encoders, smooth

FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12
HELD = np.array([-1.0, 13.0, 13.0, -1.0, 0.0]) / 24
"""Passes slow signals as holding does, to the fourth order of their frequency."""
BAND = 0.3
"""Bandwidth times step of the filtered motion."""
FASTEST = 25.0
"""Greatest bandwidth in Hz of the filtered motion."""
COMPARED, LEAST, MOST = 0.1, 3.0, 8.0
"""Bandwidth times step, and its limits in Hz, up to which law and motion are compared: servos filter their input."""
CREEPS = 0.015
"""rad/s within which friction reverses: simulators that step it in time soften it, each in its own way."""
FINE = 0.3
"""Largest noise of a velocity, as a share of that width, for which its sign is known sample by sample."""
TURNOVERS = (0.003, 0.007, 0.03, 0.06)
"""Other widths of the reversal, rad/s, that are allowed for."""
EDGE = 0.25
"""Time in s at both ends of a run in which the filter is not valid."""
WINDOW = 25
"""Samples of a window in which noise is estimated."""


def filtered(encoders: Float, step: float, lever: Float) -> tuple[Moved, Float]:
    """Motion of ``encoders`` (N, n) rad every ``step`` s; and the friction signs (N, n, k) of other ``TURNOVERS``.

    The motion's own sign is subtracted from these. Where the velocity is too noisy, signs are those of
    ``from_encoders``. ``lever`` (n,): travel of each joint that counts as 1 rad.
    """
    position = smooth(encoders, step, min(BAND / step, FASTEST))
    velocity, acceleration = derivatives(position, step)
    own = resolution(encoders)
    estimated, noise = from_encoders(encoders, step), own * _speed_noise(step)
    fine = noise < FINE * CREEPS * lever
    speed = np.where(fine, velocity, estimated.velocity) / lever
    unsure = np.where(fine, noise, estimated.velocity_spread)
    sign, doubt = expected_sign(speed, np.hypot(unsure / lever, CREEPS))
    others = [expected_sign(speed, np.hypot(unsure / lever, width))[0] - sign for width in TURNOVERS]
    moved = Moved(position, velocity, acceleration, sign, doubt, own, unsure, np.full_like(position, 1e-12))
    return moved, np.stack(others, axis=2)


def derivatives(values: Float, step: float) -> tuple[Float, Float]:
    """First and second derivative (N, n) of values (N, n) every ``step`` s, by five points of each.

    Three points would reduce the effect of a servo's damping by several per cent near the end of the band.
    """
    first, second = differentiate(values, step)
    inner = slice(2, -2)
    first[inner] = correlate1d(values, FIRST / step, axis=0)[inner]
    second[inner] = correlate1d(values, SECOND / step**2, axis=0)[inner]
    return first, second


def held(command: Float) -> Float:
    """Commands (N, n), each held over a row, as they act at the rows' times, half a row late."""
    return np.asarray(correlate1d(command, HELD, axis=0, mode="nearest"))


def resolution(encoders: Float) -> Float:
    """Noise (n,) rad of positions (N, n): median over windows of third differences, and at least that of their
    steps."""
    count = max(1, (len(encoders) - 3) // WINDOW)
    jumps = np.diff(encoders, n=3, axis=0)[: count * WINDOW]
    squares = np.mean(np.square(jumps.reshape(count, -1, encoders.shape[1])), axis=1) / 20.0
    noise = np.maximum(np.sqrt(np.median(squares, axis=0)), 1e-9)
    return np.asarray(np.maximum(noise, step_noise(encoders)))


def compared_band(step: float) -> float:
    """Hz up to which torque and motion of rows every ``step`` s are compared."""
    return min(max(COMPARED / step, LEAST), MOST)


def _speed_noise(step: float) -> float:
    """rad/s of noise of the filtered velocity, for 1 rad of white noise on the encoders."""
    return float(np.sqrt(np.sum(np.square(_answers(step)[1]))))


def _answers(step: float) -> tuple[Float, Float, Float]:
    """Position, velocity and acceleration (N, 1) in response to an impulse on the encoders."""
    count = 2 * max(50, round(2.0 / step)) + 1
    impulse = np.zeros((count, 1))
    impulse[count // 2] = 1.0
    smoothed = smooth(impulse, step, min(BAND / step, FASTEST))
    return smoothed, *derivatives(smoothed, step)


def noise(
    stiffness: Float, damping: Float, inertia: Float, resolution: Float, step: float, fast: bool = False
) -> Float:
    """Noise (n,) Nm of the law minus the motion's torque, by the encoders' (n,) rad; ``fast``: at all frequencies."""
    parts = [part[:, 0] if fast else smooth(part, step, compared_band(step))[:, 0] for part in _answers(step)]
    own = np.outer(stiffness, parts[0]) + np.outer(damping, parts[1]) + np.outer(inertia, parts[2])
    return np.asarray(resolution * np.sqrt(np.sum(own**2, axis=1)))
