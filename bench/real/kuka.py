"""KUKA LWR4+ (github.com/kjyv/FloBaRoID, LGPL-3.0: figures only). The arm's joints have torque sensors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from real.recording import Float, Recording

FOLDER = "kuka_lwr4"
JOINTS = tuple(f"lwr_{i}_joint" for i in range(7))
RUNS = (1, 2, 3)
"""1 and 2 are the same motion, 29 minutes apart; 3 is another one."""
MODELS = {"a_priori": "kuka_lwr4", "identified": "kuka_lwr4_identified"}


def read(data: Path, number: int) -> Recording:
    """One of the three runs."""
    with np.load(data / FOLDER / f"measurements_{number}.npz") as stored:
        time = stored["times"] - stored["times"][0]
        return Recording(f"run_{number}", time, stored["positions"], stored["velocities"], torque=stored["torques"])


def repeat_noise(data: Path) -> Float:
    """rms (n,) Nm over √2 of what two runs of the same motion, 29 minutes apart, differ by in torque."""
    first, second = (read(data, run) for run in RUNS[:2])
    shift = _shift(first, second)
    time = np.arange(first.time[0] + 1.0, first.time[-1] - 1.0, 0.005)
    columns = zip(np.asarray(first.torque).T, np.asarray(second.torque).T, strict=True)
    apart = [np.interp(time, first.time, a) - np.interp(time + shift, second.time, b) for a, b in columns]
    return np.asarray(np.std(apart, axis=1) / np.sqrt(2))


def _shift(first: Recording, second: Recording) -> float:
    """s by which the second run is later on the same motion."""
    time = np.arange(first.time[0] + 1.0, first.time[-1] - 1.0, 0.02)

    def apart(shift: float) -> float:
        pairs = zip(first.position.T, second.position.T, strict=True)
        return max(
            float(np.max(np.abs(np.interp(time, first.time, a) - np.interp(time + shift, second.time, b))))
            for a, b in pairs
        )

    return float(min(np.arange(-0.5, 0.5, 0.005), key=apart))


def urdf(data: Path, model: str) -> str:
    """One of the source's models without its <dynamics>: the identified one has negative friction there."""
    return re.sub(r"<dynamics[^>]*/>", "", (data / FOLDER / f"{MODELS[model]}.urdf").read_text())
