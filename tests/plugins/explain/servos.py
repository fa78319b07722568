"""A planar arm on position servos, its dynamics in closed form, and the file that its user has of it."""

from dataclasses import dataclass

import numpy as np

from tests.plugins.robot import planar_arm as arm

STEP, ROW = 0.001, 0.01
COUNT = 1e-4
"""rad of the encoders."""
ROTOR, COULOMB, VISCOUS = np.array([0.5, 0.2]), np.array([1.5, 0.8]), np.array([1.0, 0.5])
KP, KV, FORCE = np.array([900.0, 400.0]), np.array([45.0, 18.0]), 200.0
SECONDS = 14.0


@dataclass(frozen=True)
class Plant:
    """What the real arm has otherwise than the file."""

    gain: tuple[float, float] = (1.0, 1.0)
    dead: tuple[float, float] = (0.0, 0.0)
    late: int = 0
    """Rows by which commands act later."""
    coulomb: tuple[float, float] = (1.0, 1.0)
    force: tuple[float, float] = (FORCE, FORCE)


PLANTS = {
    "null": Plant(gain=(1.01, 0.99)),
    "gain": Plant(gain=(1.0, 0.7)),
    "dead": Plant(dead=(0.0, 0.008)),
    "late": Plant(late=3),
    "rough": Plant(coulomb=(2.0, 1.0)),
    "weak": Plant(force=(47.0, FORCE)),
}


def mjcf() -> str:
    joints = [
        f'<joint name="{name}" axis="0 1 0" armature="{ROTOR[i]}" frictionloss="{COULOMB[i]}" damping="{VISCOUS[i]}"/>'
        for i, name in enumerate(("shoulder", "elbow"))
    ]
    drives = [
        f'<position joint="{name}" kp="{KP[i]}" kv="{KV[i]}" forcerange="-{FORCE} {FORCE}"/>'
        for i, name in enumerate(("shoulder", "elbow"))
    ]
    return f"""<mujoco><compiler angle="radian"/><option timestep="0.001"><flag contact="disable"/></option><worldbody>
<body>{joints[0]}<inertial pos="{arm.C1} 0 0" mass="{arm.M1}" diaginertia="0.2 {arm.I1} 0.2"/>
<body pos="{arm.L1} 0 0">{joints[1]}<inertial pos="{arm.C2} 0 0" mass="{arm.M2}" diaginertia="0.06 {arm.I2} 0.06"/>
</body></body></worldbody><actuator>{"".join(drives)}</actuator></mujoco>"""


def sines():
    """Commands (N, 2) that are quick and slow by turns."""
    time = np.arange(0, SECONDS, ROW)
    told = np.empty((len(time), 2))
    for j, (slow, quick) in enumerate(((0.19, 0.83), (0.27, 1.1))):
        held = np.floor(time / 3) % 2  # Every other three seconds are slow.
        told[:, j] = 0.9 * np.sin(2 * np.pi * slow * time + j) + 0.12 * held * np.sin(2 * np.pi * quick * time)
    return told


def moves(count):
    """Commands (N, 2) of so many moves to and fro of both joints, 1.2 s each, with rests between them."""
    way = np.clip(np.arange(0, 2.0, ROW) / 1.2, 0, 1)
    way = way**3 * (10 - 15 * way + 6 * way**2)
    return np.concatenate([np.outer(1 - way if i % 2 else way, (0.9, -1.1)) for i in range(count)])


def integrated(plants, told=None):
    """Times (N,), commands (N, 2) and encoders (N, 2) of each plant: all are integrated side by side."""
    told = sines() if told is None else told
    time = ROW * np.arange(len(told))
    gain, dead, coulomb, force = (
        np.array([getattr(p, n) for p in plants]) for n in ("gain", "dead", "coulomb", "force")
    )
    q = np.repeat(told[:1], len(plants), axis=0)
    qd = np.zeros_like(q)
    seen = np.empty((len(time), len(plants), 2))
    for row in range(len(time)):
        seen[row] = np.round(q / COUNT) * COUNT
        command = np.array([told[max(0, row - p.late)] for p in plants])
        for _ in range(round(ROW / STEP)):
            error = command - q
            error = np.sign(error) * np.maximum(np.abs(error) - dead, 0)
            sign = np.tanh(qd / 0.02)
            push = np.clip(KP * gain * error - KV * qd, -force, force) - coulomb * COULOMB * sign - VISCOUS * qd
            push -= arm.coriolis(q, qd) + arm.gravity(q)
            stiff = coulomb * COULOMB / 0.02 * (1 - sign**2) + KV
            mass = arm.mass_matrix(q) + (ROTOR + STEP * stiff)[:, :, None] * np.eye(2)
            qd = qd + STEP * np.linalg.solve(mass, push[:, :, None])[:, :, 0]
            q = q + STEP * qd
    return [(time, told, seen[:, i]) for i in range(len(plants))]
