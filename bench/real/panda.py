"""Franka Emika Panda (github.com/marcocognetti/FrankaEmikaPandaDynModel, GPL-3.0: figures only).

Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca: Dynamic Identification of the Franka Emika Panda Robot With Retrieval
of Feasible Parameters Using Penalty-Based Optimization, IEEE RA-L 4(4), 2019. The arm's joints have torque sensors.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from real.describe import Link, chain
from real.recording import Recording

FOLDER = "franka_panda/Trajectory_1/rbt_log"
JOINTS = tuple(f"joint_{i}" for i in range(1, 8))
FRICTION = np.array([0.546, 0.872, 0.641, 1.279, 0.839, 0.303, 0.565]) / 2
"""Nm at high speed to either side, from the paper's sigmoids (their full height is twice that)."""

_A = (0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088)
_ALPHA = tuple(np.pi / 2 * turns for turns in (0, -1, 1, 1, -1, 1, 1))
_D = (0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0)
_LINKS = (
    Link(4.970684, (0.003875, 0.002081, -0.1750), (0.70337, -0.000139, 0.006772, 0.70661, 0.019169, 0.009117)),
    Link(0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, -0.003925, 0.010254, 0.02811, 0.000704, 0.025995)),
    Link(3.228604, (0.027518, 0.039252, -0.066502), (0.037242, -0.004761, -0.011396, 0.036155, -0.012805, 0.01083)),
    Link(3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.007796, -0.001332, 0.019552, 0.008641, 0.028323)),
    Link(1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, -0.002117, -0.004037, 0.029474, 0.000229, 0.008627)),
    Link(1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.000109, -0.001158, 0.004354, 0.000341, 0.005433)),
    Link(0.735522, (0.010517, -0.004252, 0.061597), (0.012516, -0.000428, -0.001196, 0.010027, -0.000741, 0.004815)),
)
"""Table of feasible parameters of the paper, in modified Denavit-Hartenberg frames."""


def read(data: Path) -> Recording:
    """The exciting trajectory: one number a line, seven joints in turn."""
    folder = data / FOLDER
    time = _numbers(folder, "time")
    kept = np.diff(time, prepend=-1.0) > 0
    position, velocity, torque = (_numbers(folder, n).reshape(-1, 7) for n in ("positions", "velocity", "torques"))
    dropped = len(time) - int(kept.sum())
    time = time[kept] - time[kept][0]
    return Recording("exciting", time, position[kept], velocity[kept], torque=torque[kept], dropped=dropped)


def urdf() -> str:
    """The arm of the paper: its frames and its feasible parameters."""
    return chain("panda", JOINTS, tuple(zip(_A, _ALPHA, _D, strict=True)), _LINKS)


def _numbers(folder: Path, what: str) -> np.ndarray:
    return np.array((folder / f"exciting_traj_{what}.txt").read_text().split(), dtype=np.float64)
