"""KUKA LWR4+ (github.com/kjyv/FloBaRoID, LGPL-3.0: figures only). The arm's joints have torque sensors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from real.recording import Recording

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


def urdf(data: Path, model: str) -> str:
    """One of the source's models without its <dynamics>: the identified one has negative friction there."""
    return re.sub(r"<dynamics[^>]*/>", "", (data / FOLDER / f"{MODELS[model]}.urdf").read_text())
