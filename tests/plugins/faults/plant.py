"""A small arm of three joints with trapezoidal moves: the truth of these tests, sharing no code with the plugin.

Power is standby plus, per joint, torque times speed and copper loss; torque is gravity (by the joint's own
angle), inertia, friction, and what a fault adds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwatt.frames import Frames, Layout, cut
from tests.blocks import frames_of, layout_of, marked
from tests.plugins.segment.motions import START as START

JOINTS = 3
HOME = np.array([0.2, -0.8, 0.5])
GRAVITY = np.array([0.0, 30.0, 12.0])  # Nm
INERTIA = np.array([3.0, 3.5, 0.8])  # kg m²
FRICTION = np.array([8.0, 9.0, 4.0])  # Nm
VISCOUS = np.array([6.0, 7.0, 3.0])  # Nm s/rad
LOSS = np.array([0.012, 0.012, 0.03])  # W/(Nm)²
STANDBY = 90.0  # W


@dataclass(frozen=True)
class Move:
    """Joints (1-based) with their way in rad, seconds, and seconds at rest afterwards."""

    by: dict[int, float]
    seconds: float
    rest: float = 0.4


CYCLE = (
    Move({1: 0.8}, 0.9),
    Move({2: 0.5, 3: -0.6}, 0.9),
    Move({3: -0.4}, 0.6),
    Move({2: -0.5}, 0.8),
    Move({1: -0.8, 3: 1.0}, 1.1, 0.8),
)
OTHER = (
    Move({2: 0.4}, 0.7),
    Move({1: -0.6, 2: -0.2}, 0.9),
    Move({3: 0.7}, 0.8),
    Move({1: 0.6, 2: -0.2, 3: -0.7}, 1.2, 0.9),
)


@dataclass(frozen=True)
class Fault:
    """One thing wrong in a cycle: ``kind`` spring (Nm/rad from home), friction (Nm), cut, encoder_offset (rad),
    encoder_scale (factor) or encoder_stuck, on ``joint`` (1-based)."""

    kind: str
    joint: int
    size: float = 0.0


@dataclass(frozen=True)
class Cycle:
    """One run of ``moves``: ``speed``, ``rests`` index of move → extra seconds at rest after it, ``pause``
    (index, share of the way, seconds) in the midst of a move, ``faults``; ``standby`` W on top."""

    moves: Sequence[Move] = CYCLE
    speed: float = 1.0
    rests: dict[int, float] = field(default_factory=dict)
    pause: tuple[int, float, float] | None = None
    faults: tuple[Fault, ...] = ()
    standby: float = 0.0


def share(t: np.ndarray, seconds: float) -> np.ndarray:
    """Way covered 0 … 1 with a quarter of the time speeding up and a quarter slowing down."""
    ramp = seconds / 4
    peak = 1 / (seconds - ramp)
    t = np.clip(t, 0, seconds)
    up = 0.5 * peak / ramp * np.minimum(t, ramp) ** 2
    flat = peak * np.clip(t - ramp, 0, seconds - 2 * ramp)
    left = np.clip(t - (seconds - ramp), 0, ramp)
    return up + flat + peak * left - 0.5 * peak / ramp * left**2


def way(cycle: Cycle, rate: float) -> np.ndarray:
    """Commanded positions (n, joints) of a cycle, rad."""
    rows, pose = [], HOME.copy()
    for index, move in enumerate(cycle.moves):
        seconds = move.seconds / cycle.speed
        parts = [(0.0, 1.0)]
        if cycle.pause and cycle.pause[0] == index:
            parts = [(0.0, cycle.pause[1]), (cycle.pause[1], 1.0)]
        target = pose.copy()
        for joint, by in move.by.items():
            target[joint - 1] += by
        for number, (low, high) in enumerate(parts):
            n = round(seconds * (high - low) * rate)
            s = low + (high - low) * share(np.arange(1, n + 1) / rate, n / rate)
            rows.append(pose + s[:, None] * (target - pose))
            if number + 1 < len(parts):
                rows.append(np.repeat(rows[-1][-1:], round(cycle.pause[2] * rate), axis=0))
        pose = target
        rest = move.rest / cycle.speed + cycle.rests.get(index, 0.0)
        rows.append(np.repeat(pose[None], round(rest * rate), axis=0))
    return np.concatenate(rows)


def run(cycles: Sequence[Cycle], *, rate: float = 50.0, seed: int = 0):
    """Measured positions (n, joints) rad, power (n,) W and the start of each cycle, s."""
    random = np.random.default_rng(seed)
    rest = np.repeat(HOME[None], round(rate), axis=0)
    ways = [rest, *(way(c, rate) for c in cycles)]
    starts = np.cumsum([0, *map(len, ways)])[1:-1] / rate
    q = np.concatenate(ways)
    owner = np.concatenate([np.full(len(w), i - 1) for i, w in enumerate(ways)])
    ahead = round(0.3 * rate)  # what a cycle changes is there before its first move
    owner = np.concatenate([owner[ahead:], np.full(ahead, owner[-1])])
    faults = [(owner == i, fault, fault.joint - 1) for i, cycle in enumerate(cycles) for fault in cycle.faults]
    true, extra = q.copy(), np.zeros_like(q)
    for mine, fault, j in faults:
        if fault.kind == "cut":
            true[mine, j] = HOME[j]
    w, a = np.gradient(true, 1 / rate, axis=0), np.gradient(np.gradient(true, 1 / rate, axis=0), 1 / rate, axis=0)
    for mine, fault, j in faults:
        if fault.kind == "spring":
            extra[mine, j] += fault.size * (true[mine, j] - HOME[j])
        elif fault.kind == "friction":
            extra[mine, j] += fault.size * np.tanh(w[mine, j] / 0.02)
    torque = GRAVITY * np.cos(true) + INERTIA * a + FRICTION * np.tanh(w / 0.02) + VISCOUS * w + extra
    standby = np.array([*(STANDBY + cycle.standby for cycle in cycles), STANDBY])  # the last is that of the first rest
    power = standby[owner] + (torque * w + LOSS * torque**2).sum(axis=1)
    measured = true.copy()
    for mine, fault, j in faults:
        if fault.kind == "encoder_offset":
            measured[mine, j] += fault.size
        elif fault.kind == "encoder_scale":
            measured[mine, j] = HOME[j] + fault.size * (true[mine, j] - HOME[j])
        elif fault.kind == "encoder_stuck":
            measured[mine, j] = HOME[j]
    measured = measured + 3e-5 * random.standard_normal(measured.shape)
    return measured, power + 1.5 * random.standard_normal(len(power)), starts


def layout(rate: float = 50.0, joints: int = JOINTS, arm: str = "arm") -> Layout:
    """Columns of the frames: the arm's joints and the supply's power."""
    positions = {f"{arm}.joint_{j}.position": "rad" for j in range(1, joints + 1)}
    return layout_of(positions | {"meter.supply.power": "W"}, rate)


def frames(
    positions: np.ndarray, power: np.ndarray, *, rate: float = 50.0, block: int = 5, start: int = START
) -> list[Frames]:
    """The run as blocks of frames from ``start`` ns on."""
    values = np.column_stack([positions, power])
    time = start + np.round(np.arange(len(power)) * 1e9 / rate)
    whole = frames_of(layout(rate, positions.shape[1]), 0, time, values, marked(values))
    return [cut(whole, i, i + block) for i in range(0, len(time), block)]


def recorded(cycles: Sequence[Cycle], *, seed: int = 0, block: int = 5) -> list[Frames]:
    """A run of the cycles as frames."""
    positions, power, _ = run(cycles, seed=seed)
    return frames(positions, power, block=block)
