"""The arm of ``recorded_arm`` at work, without viscous friction, as a daemon or a stage sees it: frames."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from cellwatt.emulation.arm import ArmSignals, Move
from cellwatt.frames import Frames, Layout
from cellwatt_plugins.explain.input.run import Run
from tests.blocks import frames_of, layout_of
from tests.plugins.explain.recorded_arm import COULOMB, JOINTS, NOISE, ROTOR, model, rigid, supply, write_robot

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
UNITS = {"position": "rad", "velocity": "rad/s", "torque": "Nm"}
CHANNELS = {f"arm.joint_{j}.{q}": unit for q, unit in UNITS.items() for j in range(1, JOINTS + 1)}
CHANNELS["meter.supply.power"] = "W"
LAYOUT = layout_of(CHANNELS)
START = 1_795_000_000 * 10**9
"""UTC ns of the first frame."""


@cache
def real() -> pin.Model:
    """The links of the arm."""
    with TemporaryDirectory() as folder:
        return model(write_robot(Path(folder)))


def recorded(
    seconds: float, *, viscous: float = 0.0, since: float = 0.0, until: float = math.inf, seed: int = 0
) -> Run:
    """The arm at work; from ``since`` to ``until`` s joint 2 has so many Nm s/rad of viscous friction more."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * LAYOUT.rate)) / LAYOUT.rate
    q, qd, qdd = ARM.motion(t)
    torque = rigid(real(), q, qd, qdd) + ROTOR * qdd + COULOMB * np.tanh(qd / 0.004)
    torque[:, 1] += np.where((t >= since) & (t < until), viscous * qd[:, 1], 0.0)
    return Run(
        name="arm",
        time=t,
        position=q + 2e-5 * random.standard_normal(q.shape),
        velocity=qd + 1e-3 * random.standard_normal(q.shape),
        torque=torque + 0.3 * NOISE * random.standard_normal(q.shape),
        power=supply(torque, qd) + 1.0 * random.standard_normal(len(t)),
    )


def frames(arm: Run) -> Frames:
    """The recording as one block of frames."""
    return framed(LAYOUT, np.column_stack([arm.position, arm.velocity, arm.torque, arm.power]))


def framed(lay: Layout, values: np.ndarray) -> Frames:
    """Values (n, channels) as one block of frames."""
    return frames_of(lay, 0, START + lay.step * np.arange(len(values)), values)
