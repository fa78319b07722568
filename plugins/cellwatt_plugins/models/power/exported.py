"""Fitted models as model files."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np

from cellwatt_plugins.models.export import joint_inputs, write_model
from cellwatt_plugins.models.graph import Chain
from cellwatt_plugins.models.metadata import Input, Metadata, Output, Training
from cellwatt_plugins.models.power.fitting import Fitted
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.nls import Nls
from cellwatt_plugins.models.power.paper import BESIDE, Traced
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.power.tuning import Tuning
from cellwatt_plugins.robot import Arm


def write(path: Path, fitted: Fitted, moves: Moves, arm: Arm, created: datetime | None = None) -> Metadata:
    """Writes the ONNX file and gives its metadata. Raises ``ModelError``.

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
    metadata = Metadata(
        name=f"{arm.name}-power",
        robot=arm.name,
        inputs=tuple(inputs),
        outputs=_outputs(joints, model.supply is not None),
        rate_hz=round(1 / moves.step, 3),
        window=model.smoother.window,
        delay=model.smoother.delay,
        training=Training.of(np.concatenate(table, axis=1), created),
    )
    write_model(path, model.content(Chain.of(arm.body)), metadata)
    return metadata


def write_published(path: Path, model: Nls | Scg, tuning: Tuning, moves: Moves, arm: Arm) -> Metadata:
    """The same for one of the paper's two models; inputs are positions and velocities. Raises ``ModelError``."""
    metadata = Metadata(
        name=f"{arm.name}-power-{type(model).__name__.lower()}",
        robot=arm.name,
        inputs=joint_inputs(moves.joints, "position", "velocity"),
        outputs=_outputs(moves.joints, bool(np.isfinite(moves.power).any())),
        rate_hz=round(1 / moves.step, 3),
        window=tuning.smoother.window + 2 * BESIDE,
        delay=tuning.smoother.delay + BESIDE,
        training=Training.of(np.concatenate([moves.q, moves.qd], axis=1)),
    )
    write_model(path, model.content(Traced.of(Chain.of(arm.body), tuning.smoother, tuning.width, moves.step)), metadata)
    return metadata


def _outputs(joints: int, power: bool) -> tuple[Output, ...]:
    currents = tuple(Output(f"current_{i + 1}", "A") for i in range(joints))
    return (Output("power", "W"), *currents) if power else currents
