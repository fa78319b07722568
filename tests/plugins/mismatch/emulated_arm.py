"""The arm of ``recorded_arm`` at work, served to a daemon or a stage: its torques are Pinocchio's."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from cellwatt.emulation.arm import ArmSignals, Move
from cellwatt.frames import FrameChannel, Frames, Layout
from tests.plugins.mismatch.recorded_arm import (
    CONSTANT,
    COULOMB,
    JOINTS,
    NOISE,
    RESISTANCE,
    ROTOR,
    STANDBY,
    rigid,
    urdf,
)

MOVES = (
    Move({2: 0.5, 4: -0.6}, 0.9),
    Move({1: 0.9, 3: -0.6}, 0.9),
    Move({2: -0.8, 5: 0.7}, 1.0),
    Move({3: 0.9, 6: 1.1}, 0.9),
    Move({2: 0.3, 1: -0.9}, 0.8),
    Move({3: -0.3, 4: 0.6, 5: -0.7, 6: -1.1}, 0.9),
)
"""Some 7 s a cycle; joint 2 moves in every other."""
ARM = ArmSignals(moves=MOVES, home=(0.0, -0.5, 0.9, 0.0, 0.4, 0.0))


@dataclass(frozen=True)
class Recorded:
    """Samples (N,) s of the arm: position, velocity, torque (N, 6) and power (N,)."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    power: np.ndarray


def recorded(
    seconds: float,
    rate: float,
    *,
    joint: int = 2,
    viscous: float = 0.0,
    since: float = 0.0,
    until: float = math.inf,
    seed: int = 0,
) -> Recorded:
    """The arm at work; from ``since`` to ``until`` s ``joint`` has so many Nm s/rad of viscous friction more."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q, qd, qdd = ARM.motion(t)
    torque = rigid(pin.buildModelFromXML(urdf()), q, qd, qdd) + ROTOR * qdd + COULOMB * np.tanh(qd / 0.004)
    torque[:, joint - 1] += np.where((t >= since) & (t < until), viscous * qd[:, joint - 1], 0.0)
    power = STANDBY + np.sum(torque * qd + RESISTANCE * (torque / CONSTANT) ** 2, axis=1)
    return Recorded(
        time=t,
        position=q + 2e-5 * random.standard_normal(q.shape),
        velocity=qd + 1e-3 * random.standard_normal(q.shape),
        torque=torque + 0.3 * NOISE * random.standard_normal(q.shape),
        power=power + 1.0 * random.standard_normal(len(t)),
    )


def layout(rate: float = 50.0) -> Layout:
    """Frames of the arm."""
    units = {"position": "rad", "velocity": "rad/s", "torque": "Nm"}
    channels = [
        FrameChannel(f"arm.joint_{j}.{quantity}", unit, "continuous", "linear")
        for quantity, unit in units.items()
        for j in range(1, JOINTS + 1)
    ]
    return Layout((*channels, FrameChannel("meter.supply.power", "W", "continuous", "average")), rate)


START = 1_795_000_000 * 10**9
"""UTC ns of the first frame."""


def frames(arm: Recorded, lay: Layout) -> Frames:
    """The recording as one block of frames."""
    values = np.column_stack([arm.position, arm.velocity, arm.torque, arm.power])
    time = START + lay.step * np.arange(len(values))
    quality = np.zeros(values.shape, np.uint8)
    return Frames(lay, 0, time, values, quality, np.zeros(values.shape, np.int64))


def cut(whole: Frames, first: int, last: int) -> Frames:
    """A block of frames out of a larger one."""
    part = slice(first, last)
    return Frames(
        whole.layout,
        whole.sequence + first,
        whole.time[part],
        whole.values[part],
        whole.quality[part],
        whole.bound[part],
    )
