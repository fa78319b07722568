"""The actual motion: position, velocity and acceleration, with the uncertainty of the derivatives.

Near a stop, Coulomb friction reverses within 4 mrad/s, less than differentiated encoders resolve: an unknown sign must
not be taken for an effect. So the velocity has a standard deviation, and friction is fitted with the expected sign and
the standard deviation of that sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d

from cellwatt.arrays import Bool, Float
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.robot.samples import interpolated

SIGN_WIDTH = 0.004
"""rad/s: Coulomb friction reverses within this velocity."""
FAST = 24.0
"""Sampling rate in Hz from which the fast dynamics of a drive are visible."""
ORDER = 3
"""The smoother penalises third differences (jerk)."""
ERROR_OCTAVES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Upper limits in Hz of the octaves in which the tracking error, recorded minus planned motion, is separated from
noise; of the last octave only the power is used. An arm that sticks at a reversal leaves its plan for some ms."""
OWN_OCTAVES = ERROR_OCTAVES[1:]
"""The same for a motion without a known plan; its first octave is used as it is."""
QUICK_OCTAVES = (10.0, 20.0)
"""The same for callers that cannot wait: the lower octaves need seconds of samples before and after."""
FASTEST_BAND = 0.35
"""Largest bandwidth times step of an octave that the sampling resolves."""
OWN_BANDWIDTH = 10.0
"""Bandwidth in Hz of derivatives of encoder positions alone whose uncertainty is not needed."""
HURRIED = 8.0
"""Bandwidth in Hz above which the ends of a recording are not separated from noise: half of the neighbours lack."""
SOFT = 0.4
"""Standard deviation of a friction lead, as a share of the lead."""
JERK = 0.5
"""Ratio of an acceleration's power in one octave to that in the octave below: friction makes it jump."""
# Evenly spaced nodes: Gauss-Hermite nodes turn a sharp sign change into steps as wide as the spread.
_NODES = np.linspace(-4.0, 4.0, 33)
_NODE_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.sum(np.exp(-0.5 * _NODES**2))
_WHOLE = float(np.cumsum(_NODE_WEIGHTS)[-1])
HARDLY = 0.005
"""Noise of a derivative, as a share of its standard deviation, below which it needs no smoothing."""
SURE_SIGN = 22.0
"""Argument from which tanh is 1 to the last bit."""
STIFF = 1e12
"""Largest strength of the smoother that double precision resolves: reached by 0.5 Hz at 310 samples a second."""


@dataclass(frozen=True)
class _Judge:
    """Criteria that separate an octave from encoder noise."""

    shortest: float
    """Shortest time in s over which the octave's power is averaged."""
    periods: float
    """Periods of the octave over which its power is averaged."""
    sure: float
    """Ratio to the noise's power from which the octave is used."""
    clear: float
    """Ratio to the noise's power from which an octave that is not used counts as doubt."""


BESIDE_PLAN = _Judge(shortest=0.06, periods=2.0, sure=4.0, clear=4.0)
"""Beside a plan: a tracking error lasts some ms; where none is found, the plan is used."""
ALONE = _Judge(shortest=0.4, periods=1.0, sure=2.0, clear=1.0)


@dataclass(frozen=True)
class Plan:
    """The motion that was commanded, (N, n) each."""

    position: Float
    """rad."""
    velocity: Float
    """rad/s."""
    acceleration: Float
    """rad/s²."""

    @property
    def courses(self) -> tuple[Float, Float, Float]:
        """Position, velocity and acceleration."""
        return self.position, self.velocity, self.acceleration


@dataclass(frozen=True)
class Turning:
    """Sign of Coulomb friction, (N, n) each."""

    sign: Float
    """Expected sign."""
    spread: Float
    """Standard deviation of the sign, from encoder noise."""
    held: Float
    """From 0 (moving) to 1 (reversing): a reversing arm may stick, and friction is then whatever torque holds it."""


@dataclass(frozen=True)
class Moved(Plan):
    """The motion that took place and its uncertainty, (N, n) each."""

    sign: Float
    """Expected tanh(velocity / 0.004)."""
    sign_spread: Float
    """Standard deviation of that sign, from encoder noise."""
    resolution: Float
    """Noise (n,) of the encoders, rad; 0 if the motion is known exactly."""
    velocity_spread: Float
    """Standard deviation of the velocity, rad/s."""
    acceleration_spread: Float
    """Standard deviation of the acceleration, rad/s²."""
    planned: bool = True
    """False if the motion was differentiated from encoders alone."""

    def through(self, coupling: Float) -> Moved:
        """Return the motion of motors that turn by ``coupling`` (n, n) per turn of each joint."""
        position, velocity, acceleration = (values @ coupling.T for values in self.courses)
        doubts = (self.resolution, self.velocity_spread, self.acceleration_spread)
        noise, wide, rough = (np.sqrt(np.square(doubt) @ np.square(coupling).T) for doubt in doubts)
        sign, unsure = expected_sign(velocity, wide)
        return Moved(position, velocity, acceleration, sign, unsure, noise, wide, rough, self.planned)

    def turning(self, lead: float = 0.0) -> Turning:
        """Return the sign of friction along the motion, where friction reverses ``lead`` s before the velocity does."""
        velocity, spread, sign, doubt = self.velocity, self.velocity_spread, self.sign, self.sign_spread
        if lead:
            velocity = velocity + lead * self.acceleration
            ahead = np.square(self.acceleration_spread) + np.square(SOFT * self.acceleration)
            spread = np.sqrt(np.square(spread) + lead**2 * ahead)
            sign, doubt = expected_sign(velocity, spread)
        return Turning(sign, doubt, np.exp(-0.5 * np.square(velocity) / (SIGN_WIDTH**2 + np.square(spread))))


def about_plan(position: Float, plan: Plan, step: float, filled: Bool | None = None) -> Moved:
    """Return the motion of encoders ``position`` (N, n) rad, every ``step`` s, that follow a ``plan``.

    It is the plan plus the tracking error; each octave of that error is reduced to the share that exceeds the encoders'
    noise (Wiener's filter). Positions ``filled`` in (N,) show neither noise nor how the plan was followed.
    """
    noise, error = encoder_noise(position, plan.position, filled), position - plan.position
    if filled is not None and filled.any() and not filled.all():
        rows = np.arange(len(error), dtype=np.float64)
        error = interpolated(rows, rows[~filled], error[~filled])
    smoothed = _in_octaves(error, noise, step, _octaves(step, ERROR_OCTAVES), BESIDE_PLAN)
    return _moved(plan, smoothed, noise, step, True)


def from_encoders(
    encoders: Float, step: float, octaves: Sequence[float] = OWN_OCTAVES, filled: Bool | None = None
) -> Moved:
    """Return the motion of ``encoders`` (N, n) rad alone, every ``step`` s; values ``filled`` in (N,) show no noise.

    Each of the ``octaves`` (Hz) is reduced to the share that exceeds the encoders' noise; the last one counts as doubt.
    """
    noise, octaves = encoder_noise(encoders, filled=filled), _octaves(step, octaves)
    base = smooth(encoders, step, octaves[0])
    smoothed = _in_octaves(encoders, noise, step, octaves, ALONE, base)
    return _moved(Plan(base, *differentiate(base, step)), smoothed, noise, step, False)


def exact(position: Float, velocity: Float, acceleration: Float) -> Moved:
    """Return a motion without doubt: ``position`` rad and its derivatives in s, (N, n) each, as of a plan."""
    none = np.zeros_like(velocity)
    return Moved(position, velocity, acceleration, direction(velocity), none, np.zeros(velocity.shape[1]), none, none)


def direction(velocity: Float) -> Float:
    """Return the smoothed sign of ``velocity`` (rad/s, any shape) in Coulomb friction: tanh(q̇ / 0.004)."""
    return np.tanh(velocity / SIGN_WIDTH)


def expected_sign(velocity: Float, spread: Float) -> tuple[Float, Float]:
    """Return mean and standard deviation of ``direction`` for a ``velocity`` known to ``spread`` (one sigma), rad/s."""
    # For nearly all samples the velocity is large enough that the sign is certain: only the others need the nodes.
    unsure = ~(np.abs(velocity) >= SURE_SIGN * SIGN_WIDTH + _NODES[-1] * np.abs(spread))
    mean, square = np.sign(velocity) * _WHOLE, np.full_like(velocity, _WHOLE)
    if unsure.any():
        mean[unsure], square[unsure] = _by_nodes(velocity[unsure], np.broadcast_to(spread, velocity.shape)[unsure])
    return mean, np.sqrt(np.maximum(square - mean**2, 0.0))


def _by_nodes(velocity: Float, spread: Float) -> tuple[Float, Float]:
    """Mean of the sign and of its square."""
    mean, square = np.zeros_like(velocity), np.zeros_like(velocity)
    for node, weight in zip(_NODES, _NODE_WEIGHTS, strict=True):
        sign = direction(velocity + spread * node)
        mean += weight * sign
        square += weight * sign**2
    return mean, square


def encoder_noise(position: Float, plan: Float | float = 0.0, filled: Bool | None = None) -> Float:
    """Return the white noise (n,) of positions (N, n) about a ``plan``; at least a rounding error.

    Positions ``filled`` in (N,) and repeated ones are left out: a joint at rest repeats that of a coarse encoder.
    """
    course = position - plan
    rms = np.sqrt(np.mean(np.square(np.diff(course, n=3, axis=0)), axis=0)) / np.sqrt(20.0)
    same = np.diff(position, axis=0) == 0
    known = course.copy()
    known[1:-1][same[1:] & same[:-1]] = np.nan
    if filled is not None:
        known[filled] = np.nan
    middle = white_noise(known)
    return np.asarray(np.maximum(np.where(middle > 0, middle, rms), 1e-9))


def rates(position: Float, step: float, bandwidth: float = OWN_BANDWIDTH) -> tuple[Float, Float, Float]:
    """Return positions, velocities and accelerations (N, n) of encoders ``position`` (N, n) rad every ``step`` s.

    Frequencies above ``bandwidth`` Hz are removed; ``from_encoders`` also returns the uncertainty.
    """
    smoothed = smooth(position, step, bandwidth)
    return smoothed, *differentiate(smoothed, step)


def slope(values: Float, step: float) -> Float:
    """Return the derivative (N, n) of ``values`` (N, n) every ``step`` s.

    It is limited to ``OWN_BANDWIDTH``, unless the values have hardly any noise.
    """
    plain = np.gradient(values, step, axis=0)
    clean = encoder_noise(values) / (np.sqrt(2) * step) < HARDLY * np.std(plain, axis=0)
    return np.where(clean, plain, rates(values, step)[1])


def smooth(values: Float, step: float, bandwidth: float) -> Float:
    """Return ``values`` (N, n) every ``step`` s, without frequencies above ``bandwidth`` Hz.

    Minimises |x - values|² + λ |third differences of x|² (Whittaker; Eilers, Analytical Chemistry 75, 2003), with a λ
    that halves the amplitude at the bandwidth.
    """
    angle = min(2 * np.pi * bandwidth * step, np.pi)
    strength = float((2 * np.sin(angle / 2)) ** (-2 * ORDER))
    if strength < 1e-3 or len(values) <= ORDER:
        return values.copy()
    count = int(np.ceil((strength / STIFF) ** (0.5 / ORDER)))
    if count > 1 and len(values) > ORDER * count:
        return _thinned(values, step, bandwidth, count)
    # Fewer means than that have no third difference: at such a strength, a parabola remains of so few values anyhow.
    return _solve(values, min(strength, STIFF))


def differentiate(values: Float, step: float) -> tuple[Float, Float]:
    """Return the first and second derivative (N, n) of ``values`` (N, n) every ``step`` s: central differences."""
    first = np.gradient(values, step, axis=0)
    second = np.zeros_like(values)
    second[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) / step**2
    second[0], second[-1] = second[1], second[-2]
    return first, second


@dataclass(frozen=True)
class _Smoothed(Plan):
    """The share of a signal that is not encoder noise, (N, n) each."""

    velocity_spread: Float
    acceleration_spread: Float


def _in_octaves(
    values: Float, noise: Float, step: float, octaves: Sequence[float], judge: _Judge, base: Float | None = None
) -> _Smoothed:
    """Values and their derivatives octave by octave, each reduced where and when it does not exceed encoder noise.

    Wiener's filter with the local power of each octave: a joint moves little at rest and much in a fast move. The last
    octave is not used and counts as doubt. ``base``: the values low-passed at the first octave, if that octave is used
    as it is. The power found in one octave bounds the power that may hide in the noise of the next.
    """
    parts, squares, expected = ([np.zeros_like(values) for _ in range(3)] for _ in range(3))
    lower = np.zeros_like(values) if base is None else base
    for i, bandwidth in enumerate(octaves):
        if i == 0 and base is not None:
            continue
        upper = smooth(values, step, bandwidth)
        band = (upper - lower, *differentiate(upper - lower, step))
        gains = _band_gains(step, octaves[i - 1] if i else None, bandwidth)
        width = _samples(max(judge.shortest, judge.periods / bandwidth), step)
        edge = _samples(1 / bandwidth, step) if bandwidth > HURRIED else 0
        inner = slice(edge, len(values) - edge)
        for order, (part, gain) in enumerate(zip(band, gains, strict=True)):
            own, power = np.square(gain * noise), _average(part**2, width)
            share = np.zeros_like(part)
            if i < len(octaves) - 1:
                share[inner] = np.clip(1 - judge.sure * own / np.maximum(power[inner], 1e-300), 0.0, 1.0)
            hidden = np.minimum(expected[order], (judge.clear - 1) * own)
            parts[order] += share * part
            squares[order] += share * own + np.square(1 - share) * np.maximum(power - judge.clear * own, hidden)
            expected[order] = JERK * 4.0 ** (order - 2) * np.where(share > 0, power - own, expected[order])
        lower = upper
    return _Smoothed(parts[0], parts[1], parts[2], np.sqrt(squares[1]), np.sqrt(squares[2]))


def _moved(base: Plan, smoothed: _Smoothed, noise: Float, step: float, planned: bool) -> Moved:
    """The motion of a ``base`` plus ``kept``, the motion separated from noise.

    Torque is taken at the time of the position; an offset within the sample only adds doubt.
    """
    velocity, acceleration = base.velocity + smoothed.velocity, base.acceleration + smoothed.acceleration
    wide = np.sqrt(np.square(smoothed.velocity_spread) + np.square(acceleration * step) / 12)
    sign, doubt = expected_sign(velocity, smoothed.velocity_spread)[0], expected_sign(velocity, wide)[1]
    position = base.position + smoothed.position
    return Moved(position, velocity, acceleration, sign, doubt, noise, wide, smoothed.acceleration_spread, planned)


def _octaves(step: float, octaves: Sequence[float]) -> list[float]:
    """The octaves that the sampling resolves; at least two."""
    there = [bandwidth for bandwidth in octaves if bandwidth * step < FASTEST_BAND]
    return there if len(there) > 1 else [0.5 * FASTEST_BAND / step, FASTEST_BAND / step]


@lru_cache(maxsize=256)
def _band_gains(step: float, lower: float | None, upper: float) -> tuple[float, float, float]:
    """Standard deviation of position, velocity and acceleration between two bandwidths (Hz), for white noise of 1."""
    half = max(50, _samples(4 / (lower or upper), step))
    impulse = np.zeros((2 * half + 1, 1))
    impulse[half] = 1.0
    smoothed = smooth(impulse, step, upper)
    if lower is not None:
        smoothed = smoothed - smooth(impulse, step, lower)
    gains = [float(np.sqrt(np.sum(part**2))) for part in (smoothed, *differentiate(smoothed, step))]
    return gains[0], gains[1], gains[2]


def _samples(seconds: float, step: float) -> int:
    return max(3, round(seconds / step))


def _average(squares: Float, width: int) -> Float:
    """Running average (N, n) of squares; never negative, despite the rounding of the running sum."""
    return np.asarray(np.maximum(uniform_filter1d(squares, width, axis=0, mode="nearest"), 0.0))


def _thinned(values: Float, step: float, bandwidth: float, count: int) -> Float:
    """``smooth`` by way of the means of ``count`` samples, whose frequencies are far above the bandwidth."""
    from scipy.interpolate import CubicSpline  # half a second to load, for recordings of high rates alone

    beyond = -len(values) % count
    blocks = np.pad(values, ((0, beyond), (0, 0)), "reflect", reflect_type="odd").reshape(-1, count, values.shape[1])
    middles = count * np.arange(len(blocks)) + (count - 1) / 2
    return np.asarray(
        CubicSpline(middles, smooth(blocks.mean(axis=1), count * step, bandwidth))(np.arange(len(values)))
    )


def _solve(values: Float, strength: float) -> Float:
    count = len(values)
    stencil = np.array([-1.0, 3.0, -3.0, 1.0])
    banded = np.zeros((ORDER + 1, count))
    for row in range(ORDER + 1):
        for a in range(ORDER + 1 - row):
            first = a + row
            banded[ORDER - row, first : first + count - ORDER] += strength * stencil[a] * stencil[a + row]
    banded[ORDER] += 1.0
    return np.asarray(solveh_banded(banded, values), np.float64)
