"""A motion as it is expected to be recorded: its states, how well velocities are known, and how joints warm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.input.run import Motion
from cellwatt_plugins.mismatch.model import Model, mechanical_torque
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import SIGN_WIDTH, exact, expected_sign

Float = NDArray[np.float64]

WARMS_IN = 600.0
"""s in which a joint is taken to come near the highest temperature that was recorded."""


def expected_states(name: str, motion: Motion, model: Model, recorded: Sequence[States]) -> States:
    """A motion as it is expected to be recorded: velocities known as well as in the recordings, torque by the model."""
    first = recorded[0]
    spread = np.broadcast_to(velocity_spread(recorded), motion.velocity.shape)
    sign, sign_spread = expected_sign(motion.velocity, spread)
    known = exact(motion.position, motion.velocity, motion.acceleration)
    moved = replace(
        known, sign=sign, sign_spread=sign_spread, velocity_spread=spread, resolution=first.moved.resolution
    )
    states = States(name, -1, motion.time, moved, first.arm, _temperature(motion.time, recorded))
    return states.with_torque(mechanical_torque(model, states))


def velocity_spread(recorded: Sequence[States]) -> Float:
    """Standard deviation (n,) rad/s of the velocities near stops."""
    out = np.zeros(len(recorded[0].robot.joints))
    for joint in range(len(out)):
        near = [s.moved.velocity_spread[np.abs(s.qd[:, joint]) < SIGN_WIDTH / 2, joint] for s in recorded]
        if sum(map(len, near)):
            out[joint] = np.median(np.concatenate(near))
    return out


def _temperature(time: Float, recorded: Sequence[States]) -> Float | None:
    """Joints (M, n) °C that start as cold, and become as warm, as they were recorded; None where they were not."""
    courses = [s.temperature for s in recorded if s.temperature is not None]
    if len(courses) < len(recorded):
        return None
    every = np.concatenate(courses)
    cold, warm = np.min(every, axis=0), np.max(every, axis=0)
    return np.asarray(warm - (warm - cold) * np.exp(-(time - time[0]) / WARMS_IN)[:, None])
