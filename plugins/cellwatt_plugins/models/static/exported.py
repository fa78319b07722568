"""The models of held poses as ONNX graphs in float64, with the robot's gravity, scaling and all physics inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.polynomial.legendre import leg2poly

from cellwatt.arrays import Float
from cellwatt_plugins.models.describe import write_model
from cellwatt_plugins.models.dynamics import carried, inverse_dynamics
from cellwatt_plugins.models.metadata import Input, Metadata, Output, Training, joint_inputs
from cellwatt_plugins.models.static.basis import BEYOND, PER_GRAVITY
from cellwatt_plugins.models.static.effects import BENT, PLAIN, degrees
from cellwatt_plugins.models.static.identify import HeldArm, Identified
from cellwatt_plugins.models.static.paper import Sigmoids
from cellwatt_plugins.models.static.poses import Poses
from cellwatt_plugins.onnx_graph import Graph, Tensor, beside
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.drive import copper_gain
from cellwatt_plugins.robot.effects.load.gravity_tilt import level

TOTAL: Final = "torque_sum"
"""Output: sum of the torques' absolute values, eq. 5."""
_INTERVAL: Final = (f"{TOTAL}_low", f"{TOTAL}_high")
HOLDING: Final = "holding_power"
"""Output, if robot.yaml has every torque constant and winding resistance: power that holds the pose, eqs. 3 and 4.

At rest a motor's voltage is R I, so P = τ V / K_t is R (τ / K_t)²; standby power is not included.
"""


@dataclass(frozen=True)
class Widths:
    """Half widths of the sum's prediction interval, Nm: with known directions of approach, and with unknown ones."""

    known: float
    blind: float


def write_best(path: Path, model: Identified, widths: Widths, arm: HeldArm, poses: Poses) -> None:
    """The best model: the joints' torques, their absolute sum, its prediction interval, and holding power."""
    n, carries = arm.arm.body.joints, model.effects.carries
    graph = Graph(2 * n + carries)
    q, approach = graph.input.part(0, n), graph.input.part(n, 2 * n)
    load = _load(model, arm, q, graph.input.part(2 * n, 2 * n + 1) if carries else None)
    given = graph.op("Equal", approach, approach)  # NaN, for unknown, is not equal to itself
    direction = graph.op("Sign", graph.op("Where", given, approach, 0.0))
    torque, total = model.holding(load, direction)
    all_given = graph.op("ReduceMin", graph.op("Cast", given, to=_DOUBLE), axes=[1], keepdims=1)
    width = (1.0 - all_given) * (widths.blind - widths.known) + widths.known
    parts = [torque, total, np.maximum(total - width, 0.0), total + width]
    outputs = [Output(name, "Nm") for name in (*(f"torque_{i + 1}" for i in range(n)), TOTAL, *_INTERVAL)]
    heating = copper_gain(arm.arm.description)
    if (heating > 0).all():
        parts.append((torque * torque * heating).sum(keepdims=True))
        outputs.append(Output(HOLDING, "W"))
    content = graph.model(parts, len(outputs))
    inputs = (*joint_inputs(n, "position"), *joint_inputs(n, "approach", optional=True))
    width_of = arm.limits[:, 1] - arm.limits[:, 0]
    ranges = [*_ranges(poses), *((-w, w) for w in width_of.tolist())]
    if carries:
        inputs = (*inputs, Input("tool.payload", "kg", optional=True))
        ranges.append((float(np.nanmin(poses.payload)), float(np.nanmax(poses.payload))))
    about = _about(arm, "", poses, ranges)
    write_model(path, content, Metadata(inputs=inputs, outputs=tuple(outputs), **about))


def write_paper(path: Path, network: Sigmoids | None, arm: HeldArm, poses: Poses, with_gravity: bool) -> None:
    """One of the paper's methods: gravity alone, a network alone, or the network on top of gravity."""
    n = arm.arm.body.joints
    graph = Graph(n)
    total: Any = 0.0
    seen: Any = graph.input
    if with_gravity:
        torque = inverse_dynamics(arm.arm.body, graph.input)
        total = np.abs(torque).sum(keepdims=True)
        seen = beside([seen, torque])
    if network is not None:
        total = total + network.column(seen)
    about = _about(arm, f"-{path.stem}", poses, _ranges(poses))
    metadata = Metadata(inputs=joint_inputs(n, "position"), outputs=(Output(TOTAL, "Nm"),), **about)
    write_model(path, graph.model([total], 1), metadata)


def _about(arm: HeldArm, name: str, poses: Poses, ranges: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Metadata of all files: the robot, and the poses that the model is of."""
    robot, joints = arm.arm.name, arm.arm.description.names
    training = Training(data=poses.digest, range=tuple(ranges), created=datetime.now(UTC), rows=len(poses))
    return {"name": f"{robot}-static{name}", "robot": robot, "joints": joints, "rate_hz": None, "training": training}


_DOUBLE: Final = 11  # onnx.TensorProto.DOUBLE


def _load(model: Identified, arm: HeldArm, q: Tensor, payload: Tensor | None) -> Any:
    """Torques of gravity, springs, hoses and the leftover network."""
    effects, mean = model.effects, model.posterior.mean
    inertial, field = _identified(model, arm)
    turned = q + mean[effects.slices["zero"]]
    gravity: Any = inverse_dynamics(arm.arm.body, turned, inertial=inertial, gravity=field)
    if payload is not None:
        known = q.graph.op("Where", q.graph.op("Equal", payload, payload), payload, 0.0)
        unit = carried(arm.arm.body, np.array([1.0, *mean[effects.slices["payload"]]]))
        gravity = gravity + inverse_dynamics(arm.arm.body, q, inertial=unit) * known
    load = gravity * (1.0 + mean[effects.slices["gain"]])
    if not mean[effects.linear].any() and model.leftover is None:
        return load
    share = np.maximum(np.minimum((q - arm.limits.mean(axis=1)) / effects.half, BEYOND), -BEYOND)
    if mean[effects.linear].any():
        load = load + _springs(model, share)
    return load if model.leftover is None else load + model.leftover(share)


def _identified(model: Identified, arm: HeldArm) -> tuple[Float, Float]:
    """Inertial parameters (10 n,) with the identified masses, and gravity (3,) m/s² on the tilted base."""
    effects, mean, field = model.effects, model.posterior.mean, arm.arm.body.gravity_field
    inertial = arm.arm.body.parameters().reshape(-1, PER_LINK)
    found = effects.cad + np.concatenate([mean[effects.slices[f"link {i + 1}"]] for i in range(effects.joints)])
    inertial[:, :PER_GRAVITY] = found.reshape(-1, PER_GRAVITY)
    tilt = np.linalg.norm(field) * mean[effects.slices["tilt"]]
    return inertial.reshape(-1), field + tilt @ np.eye(3)[level(field)]


def _springs(model: Identified, share: Tensor) -> Any:
    """Springs over one joint, and hoses over two: polynomials of the shares (N, n) of the joints' ranges."""
    effects, mean = model.effects, model.posterior.mean
    n, order = effects.joints, BENT + 1
    own = np.zeros((n, order))
    for j in range(n):
        own[j, :2] = mean[effects.slices[f"spring {j + 1}"]]
        own[j, 2:BENT] = mean[effects.slices[f"bent spring {j + 1}"]]
    powers = share.reshape(-1, n, 1) ** np.arange(order, dtype=np.float64)
    torque = (powers * (own @ _LEGENDRE)).sum()
    pairs = [pair for pair in effects.pairs if _energy(model, pair).any()]
    if not pairs:
        return torque
    first, last = np.array(pairs).T
    sides = [share.graph.op("Gather", powers, side, axis=1) for side in (first, last)]
    energies = np.stack([_LEGENDRE.T @ _energy(model, pair) @ _LEGENDRE for pair in pairs])
    steeper = np.diag(np.arange(1.0, order), -1)  # coefficients of the derivative: steeper.T @ coefficients
    for k, joints in enumerate((first, last)):
        matrix = steeper.T @ (energies if k == 0 else energies.swapaxes(1, 2))
        inner = (sides[k].reshape(-1, len(pairs), 1, order) @ matrix).reshape(-1, len(pairs), order)
        by_joint = np.zeros((len(pairs), n))
        by_joint[range(len(pairs)), joints] = 1.0 / effects.half[joints]
        torque = torque + (inner * sides[1 - k]).sum() @ by_joint
    return torque


def _energy(model: Identified, pair: tuple[int, int]) -> Float:
    """Coefficients of a hose's energy, by degree in the first and in the second joint."""
    out = np.zeros((BENT + 1, BENT + 1))
    name = f"{pair[0] + 1}-{pair[1] + 1}"
    for kind, terms in (("hose", degrees(0, PLAIN)), ("bent hose", degrees(PLAIN, BENT))):
        for (u, v), value in zip(terms, model.posterior.mean[model.effects.slices[f"{kind} {name}"]], strict=True):
            out[u, v] = value
    return out


_LEGENDRE: Final = np.stack([np.pad(leg2poly(unit), (0, BENT - k)) for k, unit in enumerate(np.eye(BENT + 1))])
"""(BENT + 1, BENT + 1): each polynomial's coefficients, lowest power first."""


def _ranges(poses: Poses) -> list[tuple[float, float]]:
    return list(zip(poses.q.min(axis=0).tolist(), poses.q.max(axis=0).tolist(), strict=True))
