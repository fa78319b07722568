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
"""Passes slow courses as holding does, to the fourth order of their frequency."""
BAND = 0.3
"""Bandwidth times step of the motion that is kept."""
FASTEST = 25.0
"""Hz beyond which nothing of it is asked for."""
COMPARED, LEAST, MOST = 0.1, 3.0, 8.0
"""Bandwidth times step, and Hz, up to which law and motion are compared: beyond, servos filter what drives them."""
CREEPS = 0.015
"""rad/s within which friction turns over: simulators that step it in time soften it, each in its own way."""
FINE = 0.3
"""Share of that which the noise of a velocity may have for its sign to be told sample by sample."""
TURNOVERS = (0.003, 0.007, 0.03, 0.06)
"""rad/s of the others that are allowed for."""
EDGE = 0.25
"""s at both ends of a run that a filter does not know."""
WINDOW = 25
"""Samples of a window in which noise is taken."""


def filtered(encoders: Float, step: float) -> tuple[Moved, Float]:
    """Motion of ``encoders`` (N, n) rad every ``step`` s; and the signs (N, n, k) of other ``TURNOVERS``.

    The others are less the motion's own. Where the velocity is too noisy for signs, that of ``from_encoders`` has them.
    """
    position = smooth(encoders, step, min(BAND / step, FASTEST))
    velocity, acceleration = derivatives(position, step)
    own = resolution(encoders)
    told, noise = from_encoders(encoders, step), own * _speed_noise(step)
    fine = noise < FINE * CREEPS
    speed = np.where(fine, velocity, told.velocity)
    unsure = np.where(fine, noise, told.velocity_spread)
    sign, doubt = expected_sign(speed, np.hypot(unsure, CREEPS))
    others = [expected_sign(speed, np.hypot(unsure, width))[0] - sign for width in TURNOVERS]
    moved = Moved(position, velocity, acceleration, sign, doubt, own, unsure, np.full_like(position, 1e-12))
    return moved, np.stack(others, axis=2)


def derivatives(values: Float, step: float) -> tuple[Float, Float]:
    """First and second derivative (N, n) of values (N, n) every ``step`` s, by five points of each.

    Three points would take several per cent off what a servo's damping does near the end of the band.
    """
    first, second = differentiate(values, step)
    inner = slice(2, -2)
    first[inner] = correlate1d(values, FIRST / step, axis=0)[inner]
    second[inner] = correlate1d(values, SECOND / step**2, axis=0)[inner]
    return first, second


def held(command: Float) -> Float:
    """Commands (N, n) that hold over a row each, as they act at the rows' instants, half a row late."""
    return np.asarray(correlate1d(command, HELD, axis=0, mode="nearest"))


def resolution(encoders: Float) -> Float:
    """Noise (n,) rad of positions (N, n): of third differences in the middle of all windows, and of the steps seen."""
    count = max(1, (len(encoders) - 3) // WINDOW)
    jumps = np.diff(encoders, n=3, axis=0)[: count * WINDOW]
    squares = np.mean(np.square(jumps.reshape(count, -1, encoders.shape[1])), axis=1) / 20.0
    noise = np.maximum(np.sqrt(np.median(squares, axis=0)), 1e-9)
    return np.asarray(np.maximum(noise, step_noise(encoders)))


def compared(step: float) -> float:
    """Hz up to which torque and motion of rows every ``step`` s are compared."""
    return min(max(COMPARED / step, LEAST), MOST)


def _speed_noise(step: float) -> float:
    """rad/s of the motion's velocity for 1 rad of white noise on the encoders."""
    return float(np.sqrt(np.sum(np.square(_answers(step)[1]))))


def _answers(step: float) -> tuple[Float, Float, Float]:
    """Position, velocity and acceleration (N, 1) that an impulse on the encoders makes."""
    count = 2 * max(50, round(2.0 / step)) + 1
    impulse = np.zeros((count, 1))
    impulse[count // 2] = 1.0
    kept = smooth(impulse, step, min(BAND / step, FASTEST))
    return kept, *derivatives(kept, step)


def noise(
    stiffness: Float, damping: Float, inertia: Float, resolution: Float, step: float, fast: bool = False
) -> Float:
    """Noise (n,) Nm of the law less the motion's torque, by the encoders' (n,) rad: within ``compared``, or all."""
    parts = [part[:, 0] if fast else smooth(part, step, compared(step))[:, 0] for part in _answers(step)]
    own = np.outer(stiffness, parts[0]) + np.outer(damping, parts[1]) + np.outer(inertia, parts[2])
    return np.asarray(resolution * np.sqrt(np.sum(own**2, axis=1)))
