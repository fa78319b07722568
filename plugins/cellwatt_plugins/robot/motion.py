"""The motion that really took place: position, velocity and acceleration, and how well the velocity is known.

Near a stop, Coulomb friction turns over within 4 mrad/s, less than what differentiated encoders resolve: a sign that
is not known must not be taken for an effect. So the velocity comes with its standard deviation, and friction is
judged by the expected sign and the spread of that sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d

from cellwatt.arrays import Float
from cellwatt_plugins.noise import white_noise

SIGN_WIDTH = 0.004
"""rad/s: Coulomb friction turns over within this velocity."""
FAST = 24.0
"""Samples a second that it takes to see what is quick in a drive."""
ORDER = 3
"""The smoother penalises third differences (jerk)."""
ERROR_OCTAVES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Hz up to which the tracking error, recorded minus planned motion, is told from noise; of the last octave only how
much there is. An arm that sticks at a reversal leaves its plan for some ms."""
OWN_OCTAVES = ERROR_OCTAVES[1:]
"""The same of a motion whose plan is not known; the first is kept as it is."""
QUICK_OCTAVES = (10.0, 20.0)
"""The same for who cannot wait: what is slow enough to be told from noise takes seconds before and after."""
FASTEST_BAND = 0.35
"""Bandwidth times step of the fastest octave that the sampling has."""
OWN_BANDWIDTH = 10.0
"""Hz kept where derivatives are taken from encoders alone, and no doubt of them is asked for."""
HURRIED = 8.0
"""Hz above which nothing is told from noise at the ends of a recording, where half of the neighbours lack."""
SOFT = 0.4
"""Share of its lead within which friction that turns over early does so."""
JERK = 0.5
"""Power of accelerations from one octave to the next: where friction jumps, so does the acceleration."""
# Even nodes: next to a sign that turns over at once, Gauss-Hermite nodes are steps as wide as the spread.
_NODES = np.linspace(-4.0, 4.0, 33)
_NODE_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.sum(np.exp(-0.5 * _NODES**2))
_WHOLE = float(np.cumsum(_NODE_WEIGHTS)[-1])
HARDLY = 0.005
"""Noise as a share of what is there that needs no smoothing."""
SURE_SIGN = 22.0
"""From here on tanh is 1 to the last bit."""


@dataclass(frozen=True)
class _Judge:
    """How an octave is told from encoder noise."""

    shortest: float
    """s over which its power is averaged at least."""
    periods: float
    """Periods of the octave over which it is averaged."""
    sure: float
    """Times its noise that the power must exceed to be kept at all."""
    clear: float
    """Times its noise from which an octave that is not kept is doubt."""


BESIDE_PLAN = _Judge(shortest=0.06, periods=2.0, sure=4.0, clear=4.0)
"""A tracking error comes and goes within some ms; without it the plan stands."""
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
    """The sign by which friction goes, (N, n) each."""

    sign: Float
    """As expected."""
    spread: Float
    """Its standard deviation, from what the encoders leave open."""
    held: Float
    """From 0 to 1, how far it is turning over: an arm may stick then, and friction is whatever holds it."""


@dataclass(frozen=True)
class Moved(Plan):
    """The motion that took place, and how well it is known, (N, n) each."""

    sign: Float
    """Expected tanh(velocity / 0.004)."""
    sign_spread: Float
    """Standard deviation of that sign, from what the encoders leave open."""
    resolution: Float
    """Noise (n,) of the encoders, rad; 0 where the motion is known."""
    velocity_spread: Float
    """Standard deviation of the velocity, rad/s."""
    acceleration_spread: Float
    """Standard deviation of the acceleration, rad/s²."""
    planned: bool = True
    """False where the motion had to be differentiated from encoders alone."""

    def turning(self, lead: float = 0.0) -> Turning:
        """How friction goes with the motion, where it turns over ``lead`` s before the velocity does."""
        velocity, spread, sign, doubt = self.velocity, self.velocity_spread, self.sign, self.sign_spread
        if lead:
            velocity = velocity + lead * self.acceleration
            ahead = np.square(self.acceleration_spread) + np.square(SOFT * self.acceleration)
            spread = np.sqrt(np.square(spread) + lead**2 * ahead)
            sign, doubt = expected_sign(velocity, spread)
        return Turning(sign, doubt, np.exp(-0.5 * np.square(velocity) / (SIGN_WIDTH**2 + np.square(spread))))


def about_plan(position: Float, plan: Plan, step: float) -> Moved:
    """Return the motion of encoders ``position`` (N, n) rad, every ``step`` s, that follow a ``plan``.

    It is the plan and the tracking error, of which each octave is kept as far as it exceeds the encoders' noise
    (Wiener's filter).
    """
    noise = encoder_noise(position, plan.position)
    kept = _in_octaves(position - plan.position, noise, step, _octaves(step, ERROR_OCTAVES), BESIDE_PLAN)
    return _moved(plan, kept, noise, step, True)


def from_encoders(encoders: Float, step: float, octaves: Sequence[float] = OWN_OCTAVES) -> Moved:
    """Return the motion of ``encoders`` (N, n) rad alone, every ``step`` s.

    Each of the ``octaves`` (Hz) is kept as far as it exceeds the encoders' noise; what is beyond the last is doubt.
    """
    noise, octaves = encoder_noise(encoders), _octaves(step, octaves)
    base = smooth(encoders, step, octaves[0])
    kept = _in_octaves(encoders, noise, step, octaves, ALONE, base)
    return _moved(Plan(base, *differentiate(base, step)), kept, noise, step, False)


def exact(position: Float, velocity: Float, acceleration: Float) -> Moved:
    """Return the motion of exact ``position`` rad and its derivatives in s, (N, n) each: a plan's, without doubt."""
    none = np.zeros_like(velocity)
    return Moved(position, velocity, acceleration, direction(velocity), none, np.zeros(velocity.shape[1]), none, none)


def direction(velocity: Float) -> Float:
    """Return the sign of ``velocity`` (rad/s, any shape) as Coulomb friction sees it: tanh(q̇ / 0.004)."""
    return np.tanh(velocity / SIGN_WIDTH)


def expected_sign(velocity: Float, spread: Float) -> tuple[Float, Float]:
    """Return mean and standard deviation of ``direction`` for a ``velocity`` known to ``spread`` (one sigma), rad/s."""
    # Nearly all of a motion is so quick that the sign is sure: one sum for all of it, and nodes for the rest.
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


def encoder_noise(position: Float, plan: Float | float = 0.0) -> Float:
    """Return the white noise (n,) of positions (N, n) about a ``plan``; at least a rounding error.

    A joint at rest repeats its position where its encoder is coarse: that is no sample of the noise in motion.
    """
    course = position - plan
    rms = np.sqrt(np.mean(np.square(np.diff(course, n=3, axis=0)), axis=0)) / np.sqrt(20.0)
    same = np.diff(position, axis=0) == 0
    known = course.copy()
    known[1:-1][same[1:] & same[:-1]] = np.nan
    middle = white_noise(known)
    return np.asarray(np.maximum(np.where(middle > 0, middle, rms), 1e-9))


def rates(position: Float, step: float, bandwidth: float = OWN_BANDWIDTH) -> tuple[Float, Float, Float]:
    """Return positions, velocities and accelerations (N, n) of encoders ``position`` (N, n) rad every ``step`` s.

    Without what is above ``bandwidth`` Hz; ``from_encoders`` says beside it how far they may be off.
    """
    kept = smooth(position, step, bandwidth)
    return kept, *differentiate(kept, step)


def slope(values: Float, step: float) -> Float:
    """Return the derivative (N, n) of ``values`` (N, n) every ``step`` s: all of it where they have hardly any noise.

    Others keep what is below ``OWN_BANDWIDTH``.
    """
    plain = np.gradient(values, step, axis=0)
    clean = encoder_noise(values) / (np.sqrt(2) * step) < HARDLY * np.std(plain, axis=0)
    return np.where(clean, plain, rates(values, step)[1])


def smooth(values: Float, step: float, bandwidth: float) -> Float:
    """Return ``values`` (N, n), N > 3, every ``step`` s, without what is above ``bandwidth`` Hz.

    Minimises |x - values|² + λ |third differences of x|² (Whittaker; Eilers, Analytical Chemistry 75, 2003), with a λ
    that halves the amplitude at the bandwidth.
    """
    strength = _strength(step, bandwidth)
    if strength < 1e-3:
        return values.copy()
    return _solve(values, strength)


def differentiate(values: Float, step: float) -> tuple[Float, Float]:
    """Return the first and second derivative (N, n) of ``values`` (N, n) every ``step`` s: central differences."""
    first = np.gradient(values, step, axis=0)
    second = np.zeros_like(values)
    second[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) / step**2
    second[0], second[-1] = second[1], second[-2]
    return first, second


@dataclass(frozen=True)
class _Smoothed:
    """Part of a course that is no encoder noise, (N, n) each."""

    position: Float
    velocity: Float
    acceleration: Float
    velocity_spread: Float
    acceleration_spread: Float


def _in_octaves(
    values: Float, noise: Float, step: float, octaves: Sequence[float], judge: _Judge, base: Float | None = None
) -> _Smoothed:
    """Values and their derivatives octave by octave, each shrunk where and when it is no more than encoder noise.

    Wiener's filter with the local power of each octave: at rest a joint hardly moves, in a quick move it does. What the
    last octave leaves out is none of the motion and counts as doubt. ``base``: what the first octave keeps of the
    values, where that is taken as it is. What is seen of an octave, less of it may hide in the noise of the next.
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


def _moved(base: Plan, kept: _Smoothed, noise: Float, step: float, planned: bool) -> Moved:
    """The motion of a ``base`` and what is ``kept`` beside it.

    Torque is taken at the instant of the position; that it may be another one within the sample only adds doubt.
    """
    velocity, acceleration = base.velocity + kept.velocity, base.acceleration + kept.acceleration
    wide = np.sqrt(np.square(kept.velocity_spread) + np.square(acceleration * step) / 12)
    sign, doubt = expected_sign(velocity, kept.velocity_spread)[0], expected_sign(velocity, wide)[1]
    position = base.position + kept.position
    return Moved(position, velocity, acceleration, sign, doubt, noise, wide, kept.acceleration_spread, planned)


def _octaves(step: float, octaves: Sequence[float]) -> list[float]:
    """Those that the sampling has; two at least."""
    there = [bandwidth for bandwidth in octaves if bandwidth * step < FASTEST_BAND]
    return there if len(there) > 1 else [0.5 * FASTEST_BAND / step, FASTEST_BAND / step]


@lru_cache(maxsize=256)
def _band_gains(step: float, lower: float | None, upper: float) -> tuple[float, float, float]:
    """Share of white position noise in position, velocity and acceleration between two bandwidths, Hz."""
    half = max(50, _samples(4 / (lower or upper), step))
    impulse = np.zeros((2 * half + 1, 1))
    impulse[half] = 1.0
    kept = smooth(impulse, step, upper)
    if lower is not None:
        kept = kept - smooth(impulse, step, lower)
    gains = [float(np.sqrt(np.sum(part**2))) for part in (kept, *differentiate(kept, step))]
    return gains[0], gains[1], gains[2]


def _strength(step: float, bandwidth: float) -> float:
    angle = min(2 * np.pi * bandwidth * step, np.pi)
    return float((2 * np.sin(angle / 2)) ** (-2 * ORDER))


def _samples(seconds: float, step: float) -> int:
    return max(3, round(seconds / step))


def _average(squares: Float, width: int) -> Float:
    """Running average (N, n) of squares; rounding of the running sum must not make it negative."""
    return np.asarray(np.maximum(uniform_filter1d(squares, width, axis=0, mode="nearest"), 0.0))


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
