"""A six-axis arm of Shanghai Electric (github.com/Naruton94/robot_identification; no licence stated: figures only).

Torque from motor currents at 167 Hz, three motions of 22 s. The source's links are a rough prior, far too light; no
friction is known. The wrist's torques fall with speed, which no friction does: they are left out.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from real.describe import chain
from real.identify import links_of
from real.recording import Recording

FOLDER = "naruton94"
"""A checkout of the source's repository, at its commit a75121d."""
JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
RUNS = (1, 2, 3)
RATE = 1 / 0.006
TURNED = 2
"""The joint (0-based) whose torque is recorded with the other sign, as the source's own script has it."""
WRIST = slice(3, 6)

_A = (0.0, 0.0, -0.416, -0.4208, 0.0, 0.0)
_ALPHA = tuple(np.pi / 2 * turns for turns in (0, 1, 0, 0, 1, -1))
_D = (0.1181, 0.0, 0.0, 0.1301, 0.1021, 0.0568)
_MASS = (2.0, 3.42, 1.26, 0.8, 0.8, 0.35)
_MOMENT = (
    (-0.016502, -0.025629, -0.045604),
    (0.426440, -0.012427, 0.386836),
    (0.139078, -0.000011, 0.041150),
    (0.0, 0.000225, -0.004789),
    (-0.000003, -0.000321, -0.004603),
    (0.0, -0.000037, -0.006830),
)
"""kg m."""
_INERTIA = (
    (0.003888, 0.000076, 0.003331, 0.000340, 0.000215, 0.002627),
    (0.047501, 0.000003, 0.131182, -0.052817, 0.001726, 0.086433),
    (0.002234, 0.000001, 0.026474, -0.003751, 0.0, 0.024880),
    (0.000773, 0.0, 0.000537, 0.0, -0.000006, 0.000650),
    (0.000771, 0.0, 0.000531, 0.0, 0.000006, 0.000653),
    (0.000261, 0.0, 0.000262, 0.0, 0.0, 0.000175),
)
"""kg m² about the joint's origin: xx, xy, yy, xz, yz, zz."""


def read(data: Path, run: int) -> Recording:
    """One of the three motions."""
    folder = data / FOLDER / "python_identification" / "csv_data"
    moved = np.loadtxt(folder / f"dataInput{run}.csv", delimiter=",")
    torque = np.loadtxt(folder / f"tau{run}.csv", delimiter=",")
    torque[TURNED] *= -1
    torque[WRIST] = np.nan
    time = np.arange(moved.shape[1]) / RATE
    return Recording(f"run_{run}", time, moved[:6].T, moved[6:12].T, torque=torque.T)


def urdf() -> str:
    """The arm with the links that its identification started from."""
    parameters = [[m, *mc, *i] for m, mc, i in zip(_MASS, _MOMENT, _INERTIA, strict=True)]
    return chain("shanghai", JOINTS, tuple(zip(_A, _ALPHA, _D, strict=True)), links_of(np.ravel(parameters)))
