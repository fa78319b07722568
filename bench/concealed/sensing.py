"""From what happened to what a controller reports: filters, clocks, sensors, noise and quantisation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from concealed.arms import Array
from concealed.plant import Trace


class Sensor(Protocol):
    """Changes the measured torque (N, n) of one recording at times t (N,)."""

    def read(self, t: Array, torque: Array) -> Array: ...


@dataclass(frozen=True)
class AtJoint:
    """A sensor of one joint."""

    joint: int

    def read(self, t: Array, torque: Array) -> Array:
        torque[:, self.joint] = self.seen(t, torque, torque[:, self.joint])
        return torque

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        """The joint's ``own`` torque (N,) as it is measured, of the torque (N, n) of all."""
        raise NotImplementedError


@dataclass(frozen=True)
class Gain(AtJoint):
    """Measured torque is (1 + gain) times the true one."""

    gain: float

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        return own * (1.0 + self.gain)


@dataclass(frozen=True)
class Offset(AtJoint):
    """A constant added to the measured torque."""

    offset: float

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        return own + self.offset


@dataclass(frozen=True)
class Drift(AtJoint):
    """A measured offset that grows with time, Nm/s, from zero at the start of each recording."""

    rate: float

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        return own + self.rate * t


@dataclass(frozen=True)
class Clipping(AtJoint):
    """Measured torque stops at ± limit; acts after the noise."""

    limit: float

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        return np.clip(own, -self.limit, self.limit)


@dataclass(frozen=True)
class DeadBand(AtJoint):
    """Measured torque reads zero below `band`; acts after the noise."""

    band: float

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        return own * (np.abs(own) > self.band)


@dataclass(frozen=True)
class CrossTalk(AtJoint):
    """A share of another joint's torque shows in this joint's measurement."""

    source: int
    share: float

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        return own + self.share * torque[:, self.source]


@dataclass(frozen=True)
class LooseContact(AtJoint):
    """The reading jumps between two levels `step` apart, with random dwell times of `dwell` s on average."""

    step: float
    dwell: float
    seed: int

    def seen(self, t: Array, torque: Array, own: Array) -> Array:
        rng = np.random.default_rng([self.seed, round(1e6 * abs(float(own[0])))])
        turns = np.cumsum(rng.exponential(self.dwell, 4 + int(4 * t[-1] / self.dwell)))
        return own + self.step * (np.searchsorted(turns, t) % 2)


@dataclass(frozen=True)
class Interface:
    """How the controller reports: Hz, s, rad, rad/s, Nm, W; `noise` is (n,).

    Torque and velocity are means over `window`; the current loop is a first-order lag before that.
    """

    rate: float
    current_filter: float
    window: float
    skew: float
    position_step: float
    velocity_noise: float
    noise: Array
    noise_colour: float
    meter_filter: float
    power_noise: float
    delay: float = 0.0
    clock_rate: float = 0.0
    sensors: tuple[Sensor, ...] = field(default=())
    outputs: tuple[Sensor, ...] = field(default=())


def draw_interface(rng: np.random.Generator, noise: Array, power_noise: float, rate: float) -> Interface:
    """A controller's and a meter's habits; `skew` is what its own delay compensation leaves, well below a sample."""
    return Interface(
        rate=rate,
        current_filter=rng.uniform(0.0002, 0.0006),
        window=rng.uniform(0.5, 1.0) / max(rate, 100.0),
        skew=rng.uniform(-0.0002, 0.0002),
        position_step=10 ** rng.uniform(-4.7, -4.1),
        velocity_noise=rng.uniform(0.001, 0.0035),
        noise=noise,
        noise_colour=rng.uniform(0.1, 0.3),
        meter_filter=rng.uniform(0.002, 0.006),
        power_noise=power_noise,
    )


def low_pass(x: Array, time_constant: float, tick: float) -> Array:
    """First-order filter along time, started at the first value."""
    keep = np.exp(-tick / time_constant)
    from scipy.signal import lfilter

    return np.asarray(lfilter([1 - keep], [1, -keep], x, axis=0, zi=keep * x[:1])[0])


def lag(time_constant: float, tick: float) -> float:
    """Delay in s of `low_pass` for slow signals."""
    keep = np.exp(-tick / time_constant)
    return float(tick * keep / (1 - keep))


def at(t: Array, grid: Array, x: Array) -> Array:
    """(len(t), n) values of x (N, n) at times t, linear between grid points."""
    return np.stack([np.interp(t, grid, x[:, j]) for j in range(x.shape[1])], axis=1)


def averaged(x: Array, window: float, tick: float) -> Array:
    """Mean over a window of time centred on each sample, as a decimating controller reports."""
    n = 2 * round(0.5 * window / tick) + 1
    padded = np.concatenate([np.repeat(x[:1], n // 2, axis=0), x, np.repeat(x[-1:], n // 2, axis=0)])
    total = np.cumsum(np.concatenate([np.zeros((1, x.shape[1])), padded]), axis=0)
    return np.asarray((total[n:] - total[:-n]) / n)


def report_torque(way: Interface, t: Array, grid: Array, torque: Array) -> Array:
    """Measured torque (len(t), n) before noise: filtered, late as the effect wants it, through the sensors."""
    tick = float(grid[1] - grid[0])
    filtered = averaged(low_pass(torque, way.current_filter, tick), way.window, tick)
    late = t + lag(way.current_filter, tick) + way.skew - way.delay - way.clock_rate * t
    measured = at(late, grid, filtered)
    for sensor in way.sensors:
        measured = sensor.read(t, measured)
    return measured


def coloured(rng: np.random.Generator, n: int, joints: int, share: float, rate: float) -> Array:
    """(n, joints) unit noise of which `share` of the variance has a correlation time of 25 ms."""
    keep = np.exp(-1.0 / (rate * 0.025))
    from scipy.signal import lfilter

    slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=(n + 200, joints)), axis=0)[200:]
    return np.asarray(np.sqrt(1 - share) * rng.normal(size=(n, joints)) + np.sqrt(share) * slow)


@dataclass(frozen=True)
class Reading:
    """One recording as reported, and its torque without the measurement noise; (N, n) each, power (N,)."""

    t: Array
    q: Array
    v: Array
    torque: Array
    power: Array
    clean_torque: Array
    clean_power: Array
    temperature: Array | None


def read(rng: np.random.Generator, way: Interface, trace: Trace, copy: int, seconds: float, power: Array) -> Reading:
    """What the interface reports of one copy; `power` (N,) is the true supply power on the trace's grid."""
    t = np.arange(round(seconds * way.rate)) / way.rate
    q, v, torque = (np.asarray(x[:, copy], float) for x in (trace.q, trace.v, trace.torque))
    clean = report_torque(way, t, trace.t, torque)
    n = clean.shape[1]
    noisy = clean + way.noise * coloured(rng, len(t), n, way.noise_colour, way.rate)
    for output in way.outputs:
        noisy, clean = output.read(t, noisy), output.read(t, clean)
    speed = at(t, trace.t, averaged(v, way.window, trace.tick))
    meter = low_pass(power[:, None], way.meter_filter, trace.tick)
    clean_power = at(t + lag(way.meter_filter, trace.tick), trace.t, meter)[:, 0]
    temperature = None
    if trace.temperature is not None:
        temperature = np.round(at(t, trace.t, np.asarray(trace.temperature[:, copy], float)) / 0.1) * 0.1
    return Reading(
        t,
        np.round(at(t, trace.t, q) / way.position_step) * way.position_step,
        speed + way.velocity_noise * rng.normal(size=speed.shape),
        noisy,
        clean_power + way.power_noise * rng.normal(size=len(t)),
        clean,
        clean_power,
        temperature,
    )
