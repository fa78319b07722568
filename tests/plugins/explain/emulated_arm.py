"""An arm whose torques the tests compute themselves (Newton and Euler, in world axes), served to a daemon or a stage.

Nothing here is the code under test: the URDF and ``robot.yaml`` are written by ``recorded_arm``, the equations are
those of any textbook (Siciliano et al., *Robotics*, ch. 7.5), written out in numpy.
"""

from __future__ import annotations

import math

import numpy as np

from cellwatt.emulation.arm import ArmSignals, Move
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt_plugins.explain.input.run import Run
from tests.plugins.explain.recorded_arm import (
    AXES,
    CENTRES,
    CONSTANT,
    COULOMB,
    INERTIAS,
    JOINTS,
    MASSES,
    NOISE,
    OFFSETS,
    RESISTANCE,
    ROTOR,
    STANDBY,
)

GRAVITY = 9.81
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


def _vectors(texts: tuple[str, ...]) -> np.ndarray:
    return np.array([[float(x) for x in text.split()] for text in texts])


def _rotation(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rodrigues' formula: (N, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, rest = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * cross + rest * (cross @ cross)


def rigid_torque(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques (N, 6) Nm that the links need."""
    axes, offsets, centres = _vectors(AXES), _vectors(OFFSETS), _vectors(CENTRES)
    count = len(q)
    turn = np.tile(np.eye(3), (count, 1, 1))
    place, spin, gain = np.zeros((3, count, 3))
    pull = np.tile([0.0, 0.0, GRAVITY], (count, 1))
    joints, forces, moments = [], [], []
    for i in range(JOINTS):
        arm = turn @ offsets[i]
        pull = pull + np.cross(gain, arm) + np.cross(spin, np.cross(spin, arm))
        place = place + arm
        turn = turn @ _rotation(axes[i], q[:, i])
        axis = turn @ axes[i]
        gain = gain + axis * qdd[:, i, None] + np.cross(spin, axis * qd[:, i, None])
        spin = spin + axis * qd[:, i, None]
        lever = turn @ centres[i]
        force = MASSES[i] * (pull + np.cross(gain, lever) + np.cross(spin, np.cross(spin, lever)))
        inertia = turn @ np.diag(INERTIAS[i] * np.array([1, 1, 0.6])) @ np.swapaxes(turn, 1, 2)
        own = np.einsum("nij,nj->ni", inertia, gain)
        own += np.cross(spin, np.einsum("nij,nj->ni", inertia, spin))
        joints.append((place, axis))
        forces.append(force)
        moments.append(own + np.cross(place + lever, force))
    force, moment = np.zeros((2, count, 3))
    out = np.empty((count, JOINTS))
    for i in reversed(range(JOINTS)):
        force, moment = force + forces[i], moment + moments[i]
        place, axis = joints[i]
        out[:, i] = np.sum(axis * (moment - np.cross(place, force)), axis=1)
    return out


def recorded(
    seconds: float, rate: float, *, viscous: float = 0.0, since: float = 0.0, until: float = math.inf, seed: int = 0
) -> Run:
    """The arm at work; from ``since`` to ``until`` s joint 2 has so many Nm s/rad of viscous friction more."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    q, qd, qdd = ARM.motion(t)
    torque = rigid_torque(q, qd, qdd) + ROTOR * qdd + COULOMB * np.tanh(qd / 0.004)
    torque[:, 1] += np.where((t >= since) & (t < until), viscous * qd[:, 1], 0.0)
    power = STANDBY + np.sum(torque * qd + RESISTANCE * (torque / CONSTANT) ** 2, axis=1)
    return Run(
        name="arm",
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


def frames(arm: Run, lay: Layout) -> Frames:
    """The recording as one block of frames."""
    return framed(lay, np.column_stack([arm.position, arm.velocity, arm.torque, arm.power]))


def framed(lay: Layout, values: np.ndarray) -> Frames:
    """Values (n, channels) as one block of frames."""
    time, bound = START + lay.step * np.arange(len(values)), np.zeros(values.shape, np.int64)
    return Frames(lay, 0, time, values, bound.astype(np.uint8), bound)


def cut(whole: Frames, first: int, last: int) -> Frames:
    """A block of frames out of a larger one."""
    rows = (getattr(whole, name)[first:last] for name in ("time", "values", "quality", "bound"))
    return Frames(whole.layout, whole.sequence + first, *rows)
