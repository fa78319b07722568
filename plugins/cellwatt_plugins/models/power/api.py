"""``cw.train_power``: the function behind ``cellwatt train power``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from cellwatt.errors import RecordingError
from cellwatt.files import Place, Places, paths_of, write_file
from cellwatt_plugins.models.describe import write_model
from cellwatt_plugins.models.dynamics import check_turning
from cellwatt_plugins.models.metadata import Input, Metadata, Output, Training, joint_inputs
from cellwatt_plugins.models.power.fitting import Fitted
from cellwatt_plugins.models.power.moves import Moves, read_moves
from cellwatt_plugins.models.power.nls import Nls
from cellwatt_plugins.models.power.paper import BESIDE, Traced
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.power.smoothing import Smoother
from cellwatt_plugins.models.power.training import Trained, train
from cellwatt_plugins.models.power.tuning import Tuning
from cellwatt_plugins.models.power.wording import as_json
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.description import robot_file


def write(path: Path, fitted: Fitted, moves: Moves, arm: Arm) -> Metadata:
    """Writes the ONNX file and returns its metadata. Raises ``ModelError``.

    Inputs are positions and velocities, then the payload and temperatures where the model uses them; outputs are
    ``power`` where it was measured, and ``current_1`` …
    """
    model, joints = fitted.model, moves.joints
    inputs = [*joint_inputs(joints, "position", "velocity")]
    table = [moves.q, moves.qd]
    if model.carries(joints) and moves.payload is not None:
        inputs.append(Input("tool.payload", "kg"))
        table.append(moves.payload[:, None])
    if model.temperature is not None and moves.temperature is not None:
        inputs += joint_inputs(joints, "temperature")
        table.append(moves.temperature)
    training = Training.of(np.concatenate(table, axis=1))
    about = _about(arm, "", moves, model.smoother, model.supply is not None)
    metadata = Metadata(inputs=tuple(inputs), training=training, **about)
    write_model(path, model.content(arm.body), metadata)
    return metadata


def write_published(path: Path, model: Nls | Scg, tuning: Tuning, moves: Moves, arm: Arm) -> Metadata:
    """The same for one of the paper's two models; its inputs are positions and velocities. Raises ``ModelError``."""
    inputs = joint_inputs(moves.joints, "position", "velocity")
    training = Training.of(np.concatenate([moves.q, moves.qd], axis=1))
    power = bool(np.isfinite(moves.power).any())
    about = _about(arm, f"-{type(model).__name__.lower()}", moves, tuning.smoother, power, BESIDE)
    metadata = Metadata(inputs=inputs, training=training, **about)
    write_model(path, model.predict(Traced.of(arm.body, tuning.smoother, tuning.width, moves.step)), metadata)
    return metadata


def _about(arm: Arm, name: str, moves: Moves, smoother: Smoother, power: bool, beside: int = 0) -> dict[str, Any]:
    """Metadata of both kinds of files; windows reach ``beside`` rows further than the smoother's."""
    outputs = [Output("power", "W")] if power else []
    return {
        "name": f"{arm.name}-power{name}",
        "robot": arm.name,
        "joints": arm.description.names,
        "outputs": (*outputs, *(Output(f"current_{i + 1}", "A") for i in range(moves.joints))),
        "rate_hz": round(1 / moves.step, 3),
        "window": smoother.window + 2 * beside,
        "delay": smoother.delay + beside,
    }


@dataclass(frozen=True)
class PowerModel:
    """The models of an arm's power in motion, their errors on held-out moves, and their training data."""

    trained: Trained
    moves: Moves
    arm: Arm
    inputs: tuple[Path, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The content of ``power.json``, which ``cellwatt train power --json`` prints."""
        return as_json(self.trained, self.moves)

    def save(self, folder: Place) -> list[Path]:
        """Write model.onnx (the best), nls.onnx and scg.onnx (the paper's) and power.json; return the files.

        Raises ``ModelError``, ``CellwattError``.
        """
        out, trained = Path(folder), self.trained
        write(out / "model.onnx", trained.fitted, self.moves, self.arm)
        published = {name: m for name, m in (("nls.onnx", trained.nls), ("scg.onnx", trained.scg)) if m is not None}
        for name, model in published.items():
            write_published(out / name, model, trained.tuning, self.moves, self.arm)
        write_file(out / "power.json", json.dumps(self.as_json()))
        return [out / name for name in ("model.onnx", *published, "power.json")]

    def report(self, path: Place) -> None:
        """Write the page of the training. Raises ``CellwattError`` if that fails or plotly is missing."""
        from cellwatt.report import Provenance
        from cellwatt_plugins.models.power.report import report

        report(self.trained, self.moves, self.arm.name, Provenance.here(self.inputs)).write(Path(path))


def train_power(recordings: Places, *, robot: Place, meter: Places = ()) -> PowerModel:
    """Train a model of the currents (A) and the supply power (W) of a moving arm, on recordings of its moves.

    ``recordings`` are tables with t (s), q_i (rad), qd_i (rad/s), current_i (A) and power (W), and move if a file holds
    several moves, or cellwatt's own; ``robot`` is robot.yaml, or its folder. ``meter`` are tables of power with their
    own clocks, one per recording. The same moves give the same model. Raises ``RecordingError`` if a file cannot be
    used, ``ConfigError`` if the description lacks a required key.
    """
    arm = Arm.load(robot)
    check_turning(arm.body)
    recorded, metered = paths_of(recordings), paths_of(meter)
    moves = read_moves(recorded, arm.description.names, metered)
    try:
        with threadpool_limits(1):
            trained = train(moves, arm)
    except np.linalg.LinAlgError as error:
        raise RecordingError(
            f"{', '.join(map(str, recorded))}: {len(moves)} rows do not determine a model: record more moves, "
            "of all joints"
        ) from error
    return PowerModel(trained, moves, arm, (*recorded, *metered, robot_file(robot), arm.description.urdf))
