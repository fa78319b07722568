"""``cw.train_static``: the function behind ``cellwatt train static``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from cellwatt.files import Place, Places, paths_of
from cellwatt_plugins.models.dynamics import check_turning
from cellwatt_plugins.models.static.identify import HeldArm
from cellwatt_plugins.models.static.poses import read_poses
from cellwatt_plugins.models.static.training import Trained, train, write
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.description import robot_file


@dataclass(frozen=True)
class StaticModel:
    """The models of an arm at rest, their errors on held-out poses, and the arm."""

    trained: Trained
    arm: HeldArm
    inputs: tuple[Path, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The report that ``cellwatt train static --json`` prints."""
        return self.trained.as_json()

    def save(self, folder: Place) -> list[Path]:
        """Write model.onnx (the best) and paper/*.onnx; return the files. Raises ``ModelError``."""
        return write(self.trained, self.arm, Path(folder))

    def report(self, path: Place) -> None:
        """Write the page of the training. Raises ``CellwattError`` if that fails or plotly is missing."""
        from cellwatt.report import Provenance
        from cellwatt_plugins.models.static.report import report

        report(self.trained, self.arm.arm.name, Provenance.here(self.inputs)).write(Path(path))


def train_static(recordings: Places, *, robot: Place) -> StaticModel:
    """Train a model of the torque (Nm) that an arm needs to hold still, on recordings of held poses.

    ``recordings`` are tables with q_i (rad), torque_percent_i or torque_i (Nm) and pose, or cellwatt's own, in which
    poses are recognised; ``robot`` is robot.yaml, or its folder. Raises ``RecordingError`` if a file cannot be used or
    the poses are too few, ``ConfigError`` if the description lacks a required key.
    """
    described = Arm.load(robot)
    check_turning(described.body)
    recorded = paths_of(recordings)
    poses = read_poses(recorded, described.description)
    arm = HeldArm.of(described, poses.q)
    with threadpool_limits(1):
        trained = train(poses, arm)
    return StaticModel(trained, arm, (*recorded, robot_file(robot), described.description.urdf))
