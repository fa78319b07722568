"""``cw.train_power``: what ``cellwatt train power`` calls."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from cellwatt.files import Place, Places, paths_of
from cellwatt_plugins.models.power.exported import write, write_published
from cellwatt_plugins.models.power.moves import Moves, read_moves
from cellwatt_plugins.models.power.training import Trained, train
from cellwatt_plugins.models.power.wording import as_json
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.description import robot_file


@dataclass(frozen=True)
class PowerModel:
    """The models of an arm's power in motion, their errors on moves that they have not seen, and what they are of."""

    trained: Trained
    moves: Moves
    arm: Arm
    inputs: tuple[Path, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The content of ``power.json``, which ``cellwatt train power --json`` prints."""
        return as_json(self.trained, self.moves)

    def save(self, folder: Place) -> list[Path]:
        """Write model.onnx (the best), nls.onnx and scg.onnx (the paper's) and power.json; return the files.

        Raises ``ModelError``.
        """
        out, trained = Path(folder), self.trained
        write(out / "model.onnx", trained.fitted, self.moves, self.arm)
        published = {name: m for name, m in (("nls.onnx", trained.nls), ("scg.onnx", trained.scg)) if m is not None}
        for name, model in published.items():
            write_published(out / name, model, trained.tuning, self.moves, self.arm)
        (out / "power.json").write_text(json.dumps(self.as_json()))
        return [out / name for name in ("model.onnx", *published, "power.json")]

    def report(self, path: Place) -> None:
        """Write the page of the training. Raises ``CellwattError`` where that fails or plotly is missing."""
        from cellwatt.report import Provenance
        from cellwatt_plugins.models.power.report import report

        report(self.trained, self.moves, self.arm.name, Provenance.here(self.inputs)).write(Path(path))


def train_power(recordings: Places, *, robot: Place, meter: Places = (), seed: int = 0) -> PowerModel:
    """Train a model of the currents (A) and the supply power (W) of a moving arm, on recordings of its moves.

    ``recordings`` are tables with t (s), q_i (rad), qd_i (rad/s), current_i (A) and power (W), and move where a file
    holds several, or cellwatt's own; ``robot`` is robot.yaml, or its folder. ``meter`` are tables of power on a clock
    of their own, one a recording. The same moves and ``seed`` give the same model. Raises ``RecordingError`` where a
    file cannot be used, ``ConfigError`` where the description lacks what it needs.
    """
    arm = Arm.load(robot)
    recorded, metered = paths_of(recordings), paths_of(meter)
    moves = read_moves(recorded, arm.joints, metered)
    with threadpool_limits(1):
        trained = train(moves, arm, seed)
    return PowerModel(trained, moves, arm, (*recorded, *metered, robot_file(robot), arm.description.urdf))
