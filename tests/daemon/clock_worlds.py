"""Simulated devices with clocks of their own, and what a clock model is told about them.

Shares no code with the clock model: true times are made first, device times by integrating a drift over them,
arrivals by adding a delay and letting the reader stall.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from cellwatt.clock import ClockModel

SECOND = 1_000_000_000
EPOCH = 1_760_000_000 * SECOND


@dataclass(frozen=True)
class World:
    """One device, its clock, and the way from it to the daemon; times in s unless named otherwise.

    The delay of a sample is ``least`` + one of the named distributions scaled by ``jitter``. Stalls hold all
    arrivals back to their end. Steps move the device's clock: (at, by), ``by`` None restarts it from zero.
    """

    name: str
    seconds: float = 60.0
    rate: float = 500.0
    base: int = 0
    drift_ppm: float = 30.0
    wander_ppm: float = 0.0
    wander_period: float = 600.0
    least: float = 0.0001
    jitter: float = 0.0003
    delay: Literal["exponential", "uniform", "heavy"] = "exponential"
    stall_every: float = 0.0
    stall_for: float = 0.0
    long_stalls: tuple[tuple[float, float], ...] = ()
    bracket_every: float = 0.0
    bracket_jitter: float = 0.0
    bracket_delay: float = 0.0003
    steps: tuple[tuple[float, float | None], ...] = ()
    seed: int = 0
    settings: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Block:
    """Samples read together: device and true times (n,) ns, arrival ns, brackets (device time, not before)."""

    device: np.ndarray
    true: np.ndarray
    arrival: int
    brackets: list[tuple[int, int]]


def blocks(world: World) -> Iterator[Block]:
    """What the daemon gets, in order of arrival; a driver that sees the device's time step hands over in two."""
    rng = np.random.default_rng(world.seed)
    n = int(world.seconds * world.rate)
    t = (np.arange(n) + rng.uniform(-0.02, 0.02, n)) / world.rate + 0.01
    device = device_clock(world, t)
    arrival = arrivals(world, t, rng)
    asked = brackets(world, t, rng)
    true_ns = EPOCH + np.rint(t * 1e9).astype(np.int64)
    arrival_ns = EPOCH + np.ceil(arrival * 1e9).astype(np.int64)
    stepped = np.isin(np.arange(1, n), [np.searchsorted(t, at) for at, _ in world.steps])
    edges = np.flatnonzero((np.diff(arrival_ns) > 0) | stepped) + 1
    for start, end in zip([0, *edges], [*edges, n], strict=True):
        told = [(int(device[k]), asked[k]) for k in range(start, end) if k in asked]
        yield Block(device[start:end], true_ns[start:end], int(arrival_ns[start]), told)


def device_clock(world: World, t: np.ndarray) -> np.ndarray:
    """What the device's clock shows at true times t (n,) s: ns."""
    turn = 2 * np.pi / world.wander_period
    swing = world.wander_ppm / turn * (1 - np.cos(turn * t))
    shown = t + 1e-6 * (world.drift_ppm * t + swing)
    for at, by in world.steps:
        after = t >= at
        shown = np.where(after, shown + by if by is not None else shown - shown[np.argmax(after)], shown)
    return world.base + np.rint(shown * 1e9).astype(np.int64)


def arrivals(world: World, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """When samples made at t (n,) s are read, in order, s."""
    shape = {
        "exponential": lambda: np.minimum(rng.exponential(1.0, len(t)), 10.0),
        "uniform": lambda: rng.uniform(0.0, 1.0, len(t)),
        "heavy": lambda: np.minimum(rng.pareto(1.5, len(t)), 3.0 / world.jitter),
    }[world.delay]
    came = np.maximum.accumulate(t + world.least + world.jitter * shape())
    if world.stall_every:
        phase = np.mod(came, world.stall_every)
        came = np.where(phase < world.stall_for, came - phase + world.stall_for, came)
    for start, length in world.long_stalls:
        came = np.where((came >= start) & (came < start + length), start + length, came)
    return np.maximum.accumulate(came)


def brackets(world: World, t: np.ndarray, rng: np.random.Generator) -> dict[int, int]:
    """Sample number → cell's time, ns, at which the question left that it answers."""
    if not world.bracket_every:
        return {}
    asked = np.arange(0.0, t[-1] - 1.0, world.bracket_every)
    asked += rng.uniform(0.0, world.bracket_jitter, len(asked))
    answered = asked + rng.exponential(world.bracket_delay, len(asked))
    first_after = np.searchsorted(t, answered)
    return {int(k): EPOCH + int(a * 1e9) for k, a in zip(first_after, asked, strict=True)}


@dataclass(frozen=True)
class Outcome:
    """How a model did: share of samples whose true time the bound held, and bounds, s."""

    coverage: float
    coverage_at_start: float
    bound_p50: float
    bound_p99: float
    error_p50: float
    resets: int
    rising: bool


def run(world: World, settled_after: float = 10.0) -> Outcome:
    """Run a model through a world; bounds are those after ``settled_after`` s, coverage is of all samples."""
    model = ClockModel(**world.settings)  # as the driver of this device would set it up
    times, bounds, trues = [], [], []
    for block in blocks(world):
        for device_time, not_before in block.brackets:
            model.bracket(device_time, not_before)
        time, bound = model.stamp(block.device, block.arrival)
        times.append(time)
        bounds.append(bound)
        trues.append(block.true)
    time, bound, true = np.concatenate(times), np.concatenate(bounds), np.concatenate(trues)
    error = np.abs(time - true)
    held = error <= bound
    settled = true >= EPOCH + settled_after * 1e9
    return Outcome(
        coverage=float(held.mean()),
        coverage_at_start=float(held[:100].mean()),
        bound_p50=float(np.percentile(bound[settled], 50)) / 1e9,
        bound_p99=float(np.percentile(bound[settled], 99)) / 1e9,
        error_p50=float(np.percentile(error[settled], 50)) / 1e9,
        resets=model.resets,
        rising=bool(np.all(np.diff(time) > 0)),
    )


LAN = {"least_delay": (0.0, 0.002)}
RADIO = {"least_delay": (0.005, 0.020)}
_RTDE = {"bracket_every": 1.0, "settings": LAN}
_RADIO = {"rate": 123.0, "least": 0.010, "jitter": 0.009, "settings": RADIO, "seconds": 120.0}

NAMED = (
    World("rtde loopback, brackets", **_RTDE),
    World("rtde loopback, no brackets", settings=LAN),
    World("rtde loopback, brackets at uneven times", bracket_jitter=0.1, **_RTDE),
    World("rtde, reader stalls 30 of 100 ms", stall_every=0.1, stall_for=0.03, **_RTDE),
    World("rtde, stalls of seconds", long_stalls=((7.0, 1.5), (25.0, 3.0), (40.0, 4.0)), **_RTDE),
    World("rtde, clock steps and reboot", steps=((15.0, 0.4), (25.0, -2.0), (40.0, None), (50.0, 86400.0)), **_RTDE),
    World("lan, heavy tail", delay="heavy", jitter=0.0004, **_RTDE),
    World("radio 10-100 ms", **_RADIO),
    World("radio, drift wanders", drift_ppm=150.0, wander_ppm=45.0, wander_period=3000.0, **_RADIO),
)


def random_world(seed: int, seconds: float = 40.0) -> World:
    """A world drawn at random: any base, drift, wander, delays, stalls, brackets or none, sometimes a step."""
    rng = np.random.default_rng(seed)
    period = float(rng.uniform(200, 3000))
    rate = float(rng.choice([10, 50, 123, 500]))
    least = float(10 ** rng.uniform(-5, -2))
    delay = str(rng.choice(["exponential", "uniform", "heavy"]))
    spread = float(10 ** rng.uniform(-4.5, -2.5 if delay == "heavy" else -1.5))
    brackets_every = float(rng.choice([0.0, 0.5, 1.0, 5.0]))
    steps = [(float(rng.uniform(12, 30)), [0.7, -3.0, None][int(rng.integers(3))])] if rng.random() < 0.4 else []
    return World(
        name=f"random {seed}",
        seconds=seconds,
        rate=rate,
        base=int(rng.choice([0, 10**15, EPOCH, -(10**12)])),
        drift_ppm=float(rng.uniform(-200, 200)),
        wander_ppm=float(rng.uniform(0, 1)) * 0.095 * period / (2 * np.pi),
        wander_period=period,
        least=least,
        jitter=spread,
        delay=delay,
        stall_every=(0.1 if rate > 10 else 0.13) if rng.random() < 0.4 else 0.0,
        stall_for=0.03,
        long_stalls=((float(rng.uniform(0, 30)), float(rng.uniform(0.2, 4.0))),) if rng.random() < 0.4 else (),
        bracket_every=brackets_every,
        bracket_delay=float(10 ** rng.uniform(-4, -2.3)),
        steps=tuple(steps),
        seed=seed,
        settings={"least_delay": (least * float(rng.uniform(0, 1)), least + spread + 0.002)},
    )
