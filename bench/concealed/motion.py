"""What the arm is told to do: joint trajectories that start and end at rest, sampled at the controller's tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from concealed.arms import Arm, Array

TICK = 0.001

Move = Callable[[Array], tuple[Array, float, float] | None]
"""Where a move from a point ends, its length and the pause behind it, s; None where no joint moves."""


@dataclass(frozen=True)
class Plan:
    """A motion on a regular grid: q, v, a are (N, n) in rad, rad/s, rad/s²; sample i is at i · tick."""

    style: str
    tick: float
    q: Array
    v: Array
    a: Array

    @property
    def seconds(self) -> float:
        """Length in s."""
        return len(self.q) * self.tick


def rest(u: Array) -> Array:
    """Minimum-jerk step from 0 to 1 while u goes from 0 to 1."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def from_position(style: str, q: Array, tick: float) -> Plan:
    """A plan from positions; the derivatives are central differences at the tick."""
    v = np.gradient(q, tick, axis=0)
    return Plan(style, tick, q, v, np.gradient(v, tick, axis=0))


def excite(rng: np.random.Generator, arm: Arm, seconds: float, focus: Sequence[int], tick: float = TICK) -> Plan:
    """All joints at once on a few harmonics, within range, speed and acceleration; `focus` is not used."""
    t = np.arange(round(seconds / tick)) * tick
    n, orders = arm.joints, np.arange(1, 6)
    base = rng.uniform(0.05, 0.085)
    angle = 2 * np.pi * base * orders[:, None, None] * t[None, :, None] + rng.uniform(0, 2 * np.pi, (5, 1, n))
    wave = np.sum(rng.uniform(0.4, 1.0, (5, 1, n)) / np.sqrt(orders)[:, None, None] * np.sin(angle), axis=0)
    wave *= (rest(t / 2.0) * rest((seconds - 0.3 - t) / 2.0))[:, None]
    plan = from_position("excite", wave, tick)
    fit = [np.max(np.abs(x), axis=0) for x in (plan.q, plan.v, plan.a)]
    room = np.minimum.reduce(
        [0.45 * (arm.high - arm.low) / fit[0], 0.95 * arm.speed / fit[1], 1.2 * arm.acceleration / fit[2]]
    )
    return from_position("excite", 0.5 * (arm.high + arm.low) + wave * room, tick)


def moves(style: str, points: Array, times: Array, pauses: Array, seconds: float, tick: float) -> Plan:
    """Minimum-jerk moves from point to point, (P, n), each `times[k]` s long and followed by a pause."""
    n = round(seconds / tick)
    q = np.tile(points[0], (n, 1))
    start = 0.4
    for k in range(len(points) - 1):
        if start + times[k] > seconds - 0.2:
            break
        first, last = round(start / tick), round((start + times[k]) / tick)
        u = np.arange(first, last) * tick - start
        q[first:last] = points[k] + rest(u / times[k])[:, None] * (points[k + 1] - points[k])
        q[last:] = points[k + 1]
        start += times[k] + pauses[k]
    return from_position(style, q, tick)


def move_time(arm: Arm, start: Array, end: Array, pace: float) -> float:
    """Seconds of a minimum-jerk move that keeps speed and acceleration at `pace` of the arm's."""
    way = np.abs(end - start)
    return float(
        max(np.max(1.875 * way / (pace * arm.speed)), np.sqrt(np.max(5.77 * way / (pace**2 * arm.acceleration))))
    )


def wander(style: str, here: Array, move: Move, seconds: float, tick: float) -> Plan:
    """Moves one after the other from ``here``, until the time is filled."""
    points, times, pauses, total = [here], [], [], 0.0
    while total < seconds:
        if (found := move(points[-1])) is not None:
            there, time, pause = found
            points.append(there)
            times.append(time)
            pauses.append(pause)
            total += time + pause
    return moves(style, np.array(points), np.array(times), np.array(pauses), seconds, tick)


def task(rng: np.random.Generator, arm: Arm, seconds: float, focus: Sequence[int], tick: float = TICK) -> Plan:
    """Point to point with stops; each move takes a random set of joints, those in focus more often."""

    def move(here: Array) -> tuple[Array, float, float] | None:
        moving = rng.random(arm.joints) < 0.55
        moving[list(focus)] |= rng.random(len(focus)) < 0.6
        if not moving.any():
            return None
        there = np.where(moving, rng.uniform(arm.low, arm.high), here)
        return there, max(0.5, move_time(arm, here, there, rng.uniform(0.5, 1.0))), rng.uniform(0.2, 1.2)

    return wander("task", rng.uniform(arm.low, arm.high), move, seconds, tick)


def jerky(rng: np.random.Generator, arm: Arm, seconds: float, focus: Sequence[int], tick: float = TICK) -> Plan:
    """Short hard moves with short stops, as a pick-and-place cell makes them; excites two-mass effects."""

    def move(here: Array) -> tuple[Array, float, float]:
        moving = rng.random(arm.joints) < 0.35
        moving[list(focus)] |= rng.random(len(focus)) < 0.8
        step = np.where(moving, rng.uniform(0.08, 0.35, arm.joints) * rng.choice([-1, 1], arm.joints), 0.0)
        there = here + np.where((here + step > arm.high) | (here + step < arm.low), -step, step)
        return there, max(0.28, 0.62 * move_time(arm, here, there, 1.0)), rng.uniform(0.05, 0.6)

    return wander("jerky", rng.uniform(arm.low, arm.high) * 0.7 + 0.3 * 0.5 * (arm.low + arm.high), move, seconds, tick)


def sweep(rng: np.random.Generator, arm: Arm, seconds: float, focus: Sequence[int], tick: float = TICK) -> Plan:
    """One joint after the other at constant speeds in both directions, slow to fast; focus joints first."""
    others = [int(j) for j in rng.permutation(arm.joints) if j not in focus]
    chosen = ([*focus, *others])[:3]
    speed = np.zeros((round(seconds / tick), arm.joints))
    q0 = rng.uniform(arm.low, arm.high) * 0.8 + 0.2 * 0.5 * (arm.low + arm.high)
    share = (seconds - 1.0) / len(chosen)
    for k, j in enumerate(chosen):
        q0[j] = arm.low[j] + 0.12 * (arm.high[j] - arm.low[j])
        speed[:, j] = ladder(arm, j, 0.5 + k * share, share, len(speed), tick)
    ramp = max(3, round(0.15 / tick))
    kernel = np.hanning(ramp + 2)[1:-1]
    v = np.apply_along_axis(lambda x: np.convolve(x, kernel / kernel.sum(), mode="same"), 0, speed)
    q = q0 + np.cumsum(v, axis=0) * tick
    return Plan("sweep", tick, q, v, np.gradient(v, tick, axis=0))


def ladder(arm: Arm, joint: int, start: float, seconds: float, n: int, tick: float) -> Array:
    """(n,) speeds of one joint: there and back at four speeds, in the time it is given."""
    t = np.arange(n) * tick
    out = np.zeros(n)
    room = 0.7 * (arm.high[joint] - arm.low[joint])
    levels = arm.speed[joint] * np.array([0.06, 0.2, 0.45, 0.8])
    spent = np.array([0.38, 0.26, 0.18, 0.12]) * seconds
    for level, time in zip(levels, spent, strict=True):
        leg = min(0.46 * time, room / level)
        for sign in (1.0, -1.0):
            out[(t >= start) & (t < start + leg)] = sign * level
            start += leg + 0.04 * time
        start += time - 2 * (leg + 0.04 * time)
    return out


def cycle(rng: np.random.Generator, arm: Arm, seconds: float, focus: Sequence[int], tick: float = TICK) -> Plan:
    """The same few moves again and again at full pace, with one long pause in which the arm cools down."""
    corners = [rng.uniform(arm.low, arm.high)]
    for _ in range(7):
        there = np.where(rng.random(arm.joints) < 0.6, rng.uniform(arm.low, arm.high), corners[-1])
        there[list(focus)] = rng.uniform(arm.low, arm.high)[list(focus)]
        corners.append(there)
    lengths = [max(0.5, move_time(arm, corners[k], corners[(k + 1) % 8], 1.0)) for k in range(8)]
    rounds = 1 + int(seconds / (sum(lengths) + 8 * 0.2))
    points = np.array(corners * rounds + [corners[0]])
    pauses = np.full(len(points) - 1, 0.2)
    cold = rng.uniform(0.5, 0.7) * seconds
    pauses[min(len(pauses) - 1, round(cold / (np.mean(lengths) + 0.2)))] = 0.12 * seconds
    return moves("cycle", points, np.array(lengths * rounds), pauses, seconds, tick)


STYLES: dict[str, Callable[..., Plan]] = {style.__name__: style for style in (excite, task, jerky, sweep, cycle)}
