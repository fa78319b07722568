"""``cw.train_static``: what ``cellwatt train static`` calls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from cellwatt.files import Place, Places, paths_of
from cellwatt_plugins.models.progress import Advance
from cellwatt_plugins.models.static.identify import HeldArm
from cellwatt_plugins.models.static.poses import read_poses
from cellwatt_plugins.models.static.training import Trained, steps, train, write
from cellwatt_plugins.robot import Arm


@dataclass(frozen=True)
class StaticModel:
    """The models of an arm at rest, their errors on poses that they have not seen, and the arm that they are of."""

    trained: Trained
    arm: HeldArm

    def as_json(self) -> dict[str, Any]:
        """The report that ``cellwatt train static --json`` prints."""
        return self.trained.as_json()

    def save(self, folder: Place) -> list[Path]:
        """Write model.onnx (the best) and paper/*.onnx; return the files. Raises ``ModelError``."""
        return write(self.trained, self.arm, Path(folder))


def train_static(recordings: Places, *, robot: Place, progress: Advance = lambda share, text: None) -> StaticModel:
    """Train a model of the torque (Nm) that an arm needs to hold still, on recordings of held poses.

    ``recordings`` are tables with q_i (rad), torque_percent_i or torque_i (Nm) and pose, or cellwatt's own, in which
    poses are recognised; ``robot`` is robot.yaml, or its folder. ``progress`` is told the share of the work done since
    its last call, and what comes next. Raises ``RecordingError`` where a file cannot be used, ``ConfigError`` where
    the description lacks what it needs, ``ModelError`` where there are too few poses.
    """
    described = Arm.load(robot)
    poses = read_poses(paths_of(recordings), described.description)
    arm = HeldArm.of(described, poses.q)
    with threadpool_limits(1):
        return StaticModel(train(poses, arm, lambda: progress(1 / steps(len(poses)), "training")), arm)
