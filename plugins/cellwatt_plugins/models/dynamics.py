"""Inverse dynamics of a serial arm as a few dozen ONNX nodes, whatever the number of joints.

In 4 × 4 matrices, all in the base's frame (Uicker's and Kahn's Lagrangian form; Paul, Robot Manipulators, 1981, ch. 6):
T_i the frame of joint i, Z_i its unit twist, V_i = Σ_{k≤i} Z_k q̇_k, J_i the link's pseudo-inertia. A frame's points
accelerate by A_i = V̇_i + V_i² minus gravity, and τ_k = ⟨Z_k, Σ_{i≥k} A_i T_i J_i T_iᵀ⟩. Both sums over the joints are
products with a triangular matrix of ones.
"""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.onnx_graph import Tensor, beside
from cellwatt_plugins.robot import Body
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.pseudo_inertia import pseudo_inertia


def check_turning(body: Body) -> None:
    """Raise ``ConfigError`` if a joint of an arm is not revolute: no model file holds such an arm."""
    if straight := [name for name, turns in zip(body.names, body.turns, strict=True) if not turns]:
        raise ConfigError(f"joint {straight[0]} does not turn: only arms with revolute joints are modelled")


def inverse_dynamics(
    body: Body,
    q: Tensor,
    qd: Tensor | None = None,
    qdd: Tensor | None = None,
    inertial: Float | None = None,
    gravity: Float | None = None,
) -> Tensor:
    """Joint torques (N, n) Nm for ``q`` rad, ``qd`` rad/s, ``qdd`` rad/s², (N, n) each; rigid bodies only.

    A velocity or acceleration left out is zero: without both, the torques that hold the arm still. ``inertial`` (10 n,)
    as in ``Body.parameters`` and ``gravity`` (3,) m/s² in the base's frame are the body's unless given.
    """
    count = body.joints
    own = body.parameters() if inertial is None else inertial
    twists, inertia = _pose(body, q, own.reshape(count, PER_LINK))
    falling = np.zeros((4, 4))
    falling[:3, 3] = -(body.gravity_field if gravity is None else gravity)
    accelerations = _accelerations(twists, count, qd, qdd)
    total = falling if accelerations is None else accelerations + falling
    wrenches: Tensor = total @ inertia
    above = np.triu(np.ones((count, count))) @ wrenches.reshape(-1, count, 16)
    along: Tensor = twists.reshape(-1, count, 16) * above
    return along.sum()


def carried(body: Body, load: Float) -> Float:
    """Inertial parameters (10 n,) of an arm without masses that carries a ``load`` at the last joint's frame: its m and
    m·c (3), in kg and kg m."""
    inertial = np.zeros((body.joints, PER_LINK))
    inertial[-1, : len(load)] = load
    return inertial.reshape(-1)


def _pose(body: Body, q: Tensor, inertial: Float) -> tuple[Tensor, Tensor]:
    """Unit twists Z, and inertias T J Tᵀ: (N, n, 4, 4) each."""
    count, shape = body.joints, (-1, body.joints, 4, 4)
    frames = _frames(body, q)
    screws: Tensor = frames.reshape(-1, count, 1, 16) @ _screws(body)
    turning, moving = screws.split([16, 16], axis=-1)
    twists = turning.reshape(*shape) @ (np.eye(4) - moving.reshape(*shape))
    return twists, frames @ pseudo_inertia(inertial) @ frames.transpose(0, 1, 3, 2)


def _frames(body: Body, q: Tensor) -> Tensor:
    """T: (N, n, 4, 4), each the product of the transforms up to its joint."""
    count = body.joints
    still, sine, cosine = _transforms(body)
    weights = np.zeros((2, count, count, 16))
    weights[:, range(count), range(count)] = sine.reshape(count, 16), cosine.reshape(count, 16)
    angles = beside([np.sin(q), np.cos(q)])
    local = q.graph.op("Gemm", angles, weights.reshape(2 * count, -1), still.reshape(-1))
    parts = local.reshape(-1, count, 4, 4).split([1] * count, axis=1)
    for i in range(1, count):
        parts[i] = parts[i - 1] @ parts[i]
    return q.graph.op("Concat", *parts, axis=1)


def _transforms(body: Body) -> tuple[Float, Float, Float]:
    """The joints' transforms as A + sin q · B + cos q · C, each (n, 4, 4); Rodrigues' formula."""
    skew = np.zeros((body.joints, 4, 4))
    skew[:, :3, :3] = _skew_of(body.axes)
    square, one = skew @ skew, np.eye(4)
    return body.placements @ (one + square), body.placements @ skew, -body.placements @ square


def _skew_of(vectors: Float) -> Float:
    """Matrices (n, 3, 3) with K · x = v × x for vectors v (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def _screws(body: Body) -> Float:
    """(n, 16, 32): from a flat frame to the skew matrix of its axis, and to one with its origin as last column."""
    out = np.zeros((body.joints, 4, 4, 2, 4, 4))
    for row in range(3):
        unit = np.eye(3)[row][None]
        for column in range(3):
            out[:, row, column, 0, :3, :3] = body.axes[:, column, None, None] * _skew_of(unit)[0]
        out[:, row, 3, 1, row, 3] = 1.0
    return out.reshape(body.joints, 16, 32)


def _accelerations(twists: Tensor, count: int, qd: Tensor | None, qdd: Tensor | None) -> Tensor | None:
    """V̇ + V²: (N, n, 4, 4); V̇_i = Σ_{k≤i} (Z_k q̈_k + [V_k, Z_k] q̇_k)."""
    below = np.tril(np.ones((count, count)))

    def accumulated(x: Tensor) -> Tensor:
        sums: Tensor = below @ x.reshape(-1, count, 16)
        return sums.reshape(-1, count, 4, 4)

    driven = None if qdd is None else twists * qdd.reshape(-1, count, 1, 1)
    if qd is None:
        return None if driven is None else accumulated(driven)
    own = twists * qd.reshape(-1, count, 1, 1)
    velocity = accumulated(own)
    bracket = velocity @ own - own @ velocity
    found: Tensor = accumulated(bracket if driven is None else driven + bracket) + velocity @ velocity
    return found
