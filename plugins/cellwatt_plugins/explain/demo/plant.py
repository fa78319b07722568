"""The real arm of the demo: MuJoCo steps it with the concealed physics; its controller knows the simulation only."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.demo.arm import JOINTS, RANGES, Arm, mjcf
from cellwatt_plugins.explain.demo.physics import Concealed
from cellwatt_plugins.robot.mjcf import library
from cellwatt_plugins.robot.motion import Plan

STEP = 0.001
"""Time step of MuJoCo, s."""
EVERY = 4
"""Steps per sample."""
SECONDS = (32.0, 36.0)
"""Length of each run, s."""
SETTLE = 0.5
"""Rest before a run, s."""
RAMP = 1.5
"""Time in which a swing starts and stops, s."""
BAND = 8.0
"""Bandwidth of the controller's loop, Hz."""
POSITION_NOISE, VELOCITY_NOISE, TORQUE_NOISE = 2e-5, 1e-3, np.array([0.25, 0.25, 0.15, 0.05])
"""Standard deviations: rad, rad/s, Nm of each joint."""


@dataclass(frozen=True)
class Log:
    """Samples of one run: time (N,), the others (N, n)."""

    time: Float
    position: Float
    velocity: Float
    torque: Float


def motions(rng: np.random.Generator) -> list[Plan]:
    """Two motions on MuJoCo's steps: all joints swing at once; then from point to point, fast and slow, with rests."""
    return [_swings(rng, SECONDS[0]), _moves(rng, SECONDS[1])]


def _swings(rng: np.random.Generator, seconds: float) -> Plan:
    """Five sines a joint, from rest to rest."""
    t = np.arange(round(seconds / STEP)) * STEP
    half = 0.38 * np.ptp(RANGES, axis=1)
    speed = 2 * np.pi / seconds * rng.permuted(np.tile(np.arange(2, 13), (JOINTS, 1)), axis=1)[:, :5]
    size = rng.dirichlet(np.full(5, 2.0), JOINTS) * half[:, None]
    waves = np.sum(size * np.sin(t[:, None, None] * speed + rng.uniform(0, 2 * np.pi, (JOINTS, 5))), axis=2)
    s = np.clip(np.minimum(t, t[-1] - t) / RAMP, 0, 1)
    q = RANGES.mean(axis=1) + waves * (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
    qd = np.gradient(q, STEP, axis=0)
    return Plan(q, qd, np.gradient(qd, STEP, axis=0))


def _moves(rng: np.random.Generator, seconds: float) -> Plan:
    """Minimum-jerk moves between poses; every third one is slow."""
    n = round(seconds / STEP)
    q, qd, qdd = (np.zeros((n, JOINTS)) for _ in range(3))
    middle, half = RANGES.mean(axis=1), 0.38 * np.ptp(RANGES, axis=1)
    pose, at, count = middle + half * rng.uniform(-1, 1, JOINTS), 0, 0
    while at < n:
        target = middle + half * rng.uniform(-1, 1, JOINTS)
        if count % 3 == 2:
            target = pose + 0.25 * (target - pose)
        lasts = rng.uniform(3.0, 4.0) if count % 3 == 2 else rng.uniform(1.2, 2.2)
        s = np.arange(round(lasts / STEP)) * STEP / lasts
        way = target - pose
        course = 10 * s**3 - 15 * s**4 + 6 * s**5
        rate = (30 * s**2 - 60 * s**3 + 30 * s**4) / lasts
        bend = (60 * s - 180 * s**2 + 120 * s**3) / lasts**2
        end = min(n, at + len(s))
        for out, values, start in ((q, course, pose), (qd, rate, 0.0), (qdd, bend, 0.0)):
            out[at:end] = (start + values[:, None] * way)[: end - at]
        at, pose, count = end, target, count + 1
        rest = min(n, at + round(rng.uniform(0.2, 0.6) / STEP))
        q[at:rest] = pose
        at = rest
    return Plan(q, qd, qdd)


def run(arm: Arm, simulation: Path, concealed: Sequence[Concealed], motion: Plan, rng: np.random.Generator) -> Log:
    """Run one motion under a PD controller that feeds forward the torque of ``simulation``, the user's file.

    Logged position, velocity and motor torque are of one instant, with sensor noise.
    """
    mujoco = library(simulation)
    model = mujoco.MjModel.from_xml_string(_with(arm, concealed))
    data = mujoco.MjData(model)
    wanted = _feed_forward(mujoco, simulation, motion)
    stiffness, damping = _gains(mujoco, model, data, motion)
    dry = model.dof_frictionloss.copy()
    sticking = [(each.joint, each.numbers) for each in concealed if each.kind == "stribeck"]
    n = len(motion.position)
    data.qpos[:] = motion.position[0]
    q, qd, torque = (np.empty((n, JOINTS)) for _ in range(3))
    for i in range(-round(SETTLE / STEP), n):
        k = max(i, 0)
        off = stiffness * (motion.position[k] - data.qpos) + damping * (motion.velocity[k] - data.qvel)
        data.ctrl[:] = wanted[k] + off
        for joint, value in sticking:
            slow = np.exp(-((data.qvel[joint] / value["velocity"][0]) ** 2))
            model.dof_frictionloss[joint] = dry[joint] + value["excess"][0] * slow
        q[k], qd[k], torque[k] = data.qpos, data.qvel, data.ctrl
        mujoco.mj_step(model, data)
    return _measured(q, qd, torque, concealed, rng)


def _with(arm: Arm, concealed: Sequence[Concealed]) -> str:
    """The real arm's MJCF: friction that reverses at once, and the concealed physics for which MJCF has attributes."""
    root = ET.fromstring(mjcf(arm))
    joints = list(root.iter("joint"))
    for joint in joints:
        joint.attrib.pop("range")
        joint.set("solreffriction", "0.002 1")
    for each in concealed:
        value = {name: number for name, (number, _) in each.numbers.items()}
        joint = joints[each.joint or 0]
        if each.kind == "friction":
            joint.set("frictionloss", repr(value["now"]))
        elif each.kind == "spring":
            joint.set("stiffness", repr(value["stiffness"]))
            joint.set("springref", repr(value["rest"]))
        elif each.kind == "payload":
            last = list(root.iter("body"))[-1]
            body = ET.SubElement(last, "body", pos=f"{each.hidden['aside']} 0 {each.hidden['reach']}")
            size = 0.4 * value["mass"] * 0.04**2
            ET.SubElement(body, "inertial", pos="0 0 0", mass=str(value["mass"]), diaginertia=f"{size} {size} {size}")
    return ET.tostring(root, encoding="unicode")


def _feed_forward(mujoco: Any, simulation: Path, motion: Plan) -> Float:
    """Torque (N, n) Nm of the motion according to the user's file."""
    model = mujoco.MjModel.from_xml_path(str(simulation))
    data = mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    out = np.empty_like(motion.position)
    for i in range(len(out)):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion.position[i], motion.velocity[i], motion.acceleration[i]
        mujoco.mj_inverse(model, data)
        out[i] = data.qfrc_inverse
    return np.asarray(out + model.dof_frictionloss * np.tanh(motion.velocity / 0.02))


def _gains(mujoco: Any, model: Any, data: Any, motion: Plan) -> tuple[Float, Float]:
    """Stiffness and damping (n,) of a loop with bandwidth ``BAND`` at the inertia of each joint."""
    data.qpos[:] = motion.position[0]
    mujoco.mj_forward(model, data)
    felt, column = np.empty(JOINTS), np.empty(JOINTS)
    for j, way in enumerate(np.eye(JOINTS)):
        mujoco.mj_mulM(model, data, column, way)
        felt[j] = column[j]
    speed = 2 * np.pi * BAND
    return felt * speed**2, felt * 2 * speed


def _measured(q: Float, qd: Float, torque: Float, concealed: Sequence[Concealed], rng: np.random.Generator) -> Log:
    """The log of a run: every fourth step, with the faults and the noise of the sensors."""
    time = np.arange(len(q), dtype=np.float64) * STEP
    seen = torque.copy()
    for each in concealed:
        value = {name: number for name, (number, _) in each.numbers.items()}
        if each.kind == "gain":
            seen[:, each.joint] *= 1 + value["gain"]
        elif each.kind == "offset":
            seen[:, each.joint] += value["offset"]
        elif each.kind == "delay":
            seen = np.column_stack([np.interp(time - value["delay"], time, column) for column in seen.T])
    rows = slice(None, None, EVERY)
    q, qd, seen = q[rows], qd[rows], seen[rows]

    def noisy(values: Float, spread: Float | float) -> Float:
        return np.asarray(values + spread * rng.standard_normal(values.shape), np.float64)

    return Log(time[rows], noisy(q, POSITION_NOISE), noisy(qd, VELOCITY_NOISE), noisy(seen, TORQUE_NOISE))
