"""Cycles whose power comes from a slow meter: identifies the meter, and reconstructs power between its values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack
from scipy.sparse.linalg import spsolve

from cellwatt.arrays import Float, rows_of
from cellwatt.errors import ModelError
from cellwatt_plugins.faults.cycles.bare_arm import BareArm
from cellwatt_plugins.faults.cycles.pattern import Pattern, Warp
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import without_jumps
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_power
from cellwatt_plugins.robot.meter.model import Meter, Readings, Windows
from cellwatt_plugins.robot.motion import rates

STIFFNESS = np.geomspace(1e-4, 1e4, 9)
"""Weights tried for the power's second differences, relative to the meter's values."""
FEWEST = 2
"""Fewest values that determine the level of a power; one would leave it open."""
NEAR = 0.15
"""Width over which the scatter of the meter's values is averaged, s of the pattern."""


def with_meter(recording: Recording, arm: Arm | BareArm) -> Recording:
    """The recording with the slow meter that measured its power, if it was one.

    Raises ``ModelError`` if the motion does not show which time each value covers.
    """
    readings = recording.readings_every(None)
    if readings is None:
        return recording
    q, qd, qdd = rates(without_jumps(recording.position), recording.step)
    # Rotors and friction may differ from the description: their power has weights of its own.
    described = np.abs(qd) if isinstance(arm, BareArm) else kinds_of_power(arm.torque(q, qd, qdd), qd)
    kinds = np.column_stack([described, qd * qdd, qd**2])
    meter = find([readings], [Course(recording.time, kinds)])
    if meter is None:
        raise ModelError(
            f"power comes every {readings.interval:.2g} s, and the motion does not tell when each value was "
            "measured: record more healthy cycles, or use a faster meter"
        )
    return replace(recording, meter=meter)


def power_through(meter: Meter, readings: Readings, pattern: Pattern, warps: Sequence[Warp]) -> tuple[Float, Float]:
    """Power (T,) W of a pattern, and the scatter (T,) W of the meter's values about it.

    The values fall at other times in every cycle. The power is the smoothest whose means match them; the smoothness is
    the one that best predicts the values of a cycle left out. Raises ``ModelError`` if they are too few.
    """
    cycles = [_of_cycle(meter.windows(readings), readings.value, pattern, warp) for warp in warps]
    if sum(len(value) for _, value in cycles) < FEWEST:
        raise ModelError(
            f"{pattern.task}: fewer than {FEWEST} values of the power meter are of one cycle alone, each a mean over "
            f"{meter.window:.2g} s: record more cycles, or use a faster meter"
        )
    count = len(pattern.time)
    rough = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    bend = csr_array(rough.T @ rough)
    errors = {}
    for stiffness in STIFFNESS:
        parts = []
        for out, (matrix, value) in enumerate(cycles):
            others = [each for k, each in enumerate(cycles) if k != out] or cycles
            parts.append(value - matrix @ _solved(others, stiffness * bend))
        errors[stiffness] = np.concatenate(parts)
    best = min(errors, key=lambda stiffness: float(np.mean(errors[stiffness] ** 2)))
    middle = np.concatenate([matrix @ pattern.time for matrix, _ in cycles])
    near = np.exp(-0.5 * ((pattern.time[:, None] - middle) / (NEAR / 2)) ** 2)
    spread = np.sqrt(near @ errors[best] ** 2 / np.maximum(near.sum(axis=1), 1e-9))
    return _solved(cycles, best * bend), spread


def _of_cycle(windows: Windows, value: Float, pattern: Pattern, warp: Warp) -> tuple[csr_array, Float]:
    """Weights (M, T) of a pattern's samples in the meter's values of one cycle, and these values (M,) W."""
    own = Windows(warp.to_pattern(windows.start), warp.to_pattern(windows.end))
    inside = own.inside(pattern.time)
    return rows_of(own, inside).weights(pattern.time), value[inside]


def _solved(cycles: Sequence[tuple[csr_array, Float]], bend: csr_array) -> Float:
    matrix = vstack([each for each, _ in cycles])
    value = np.concatenate([each for _, each in cycles])
    return np.asarray(spsolve(csr_array(matrix.T @ matrix + bend).tocsc(), matrix.T @ value))
