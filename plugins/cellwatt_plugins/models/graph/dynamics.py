"""Inverse dynamics of a serial arm as a few dozen ONNX nodes, whatever the number of joints.

In 4 × 4 matrices, all in the base's frame (Uicker's and Kahn's Lagrangian form; Paul, Robot Manipulators, 1981, ch. 6):
T_i the frame of joint i, Z_i its unit twist, V_i = Σ_{k≤i} Z_k q̇_k, J_i the link's pseudo-inertia. A frame's points
accelerate by A_i = V̇_i + V_i² minus gravity, and τ_k = ⟨Z_k, Σ_{i≥k} A_i T_i J_i T_iᵀ⟩. Both sums over the joints are
products with a triangular matrix of ones.
"""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.models.graph.builder import Graph
from cellwatt_plugins.models.graph.chain import Chain, skew_of
from cellwatt_plugins.robot.pseudo_inertia import pseudo_inertia


def inverse_dynamics(graph: Graph, chain: Chain, q: str, qd: str | None = None, qdd: str | None = None) -> str:
    """Joint torques (N, n) Nm for tensors ``q`` rad, ``qd`` rad/s, ``qdd`` rad/s², (N, n) each; rigid bodies only.

    A velocity or acceleration left out is zero: without both, the torques that hold the arm still.
    """
    count = chain.joints
    twists, inertia = _pose(graph, chain, q)
    gravity = np.zeros((4, 4))
    gravity[:3, 3] = -chain.gravity
    accelerations = _accelerations(graph, twists, count, qd, qdd)
    total = graph.constant(gravity) if accelerations is None else graph.op("Add", accelerations, gravity)
    wrenches = graph.op("MatMul", total, inertia)
    above = graph.op("MatMul", np.triu(np.ones((count, count))), graph.reshape(wrenches, (-1, count, 16)))
    return graph.sum(graph.op("Mul", graph.reshape(twists, (-1, count, 16)), above))


def _pose(graph: Graph, chain: Chain, q: str) -> tuple[str, str]:
    """Unit twists Z, and inertias T J Tᵀ: (N, n, 4, 4) each."""
    count = chain.joints
    frames = _frames(graph, chain, q)
    flat = graph.reshape(frames, (-1, count, 1, 16))
    turning, moving = graph.ops("Split", 2, graph.op("MatMul", flat, _screws(chain)), np.array([16, 16]), axis=-1)
    shape = (-1, count, 4, 4)
    origin = graph.op("Sub", np.eye(4), graph.reshape(moving, shape))
    twists = graph.op("MatMul", graph.reshape(turning, shape), origin)
    turned = graph.op("Transpose", frames, perm=[0, 1, 3, 2])
    return twists, graph.op("MatMul", graph.op("MatMul", frames, pseudo_inertia(chain.inertial)), turned)


def _frames(graph: Graph, chain: Chain, q: str) -> str:
    """T: (N, n, 4, 4), each the product of the transforms up to its joint."""
    count = chain.joints
    still, sine, cosine = chain.transforms()
    angles = graph.concat([graph.op("Sin", q), graph.op("Cos", q)])
    weights = np.zeros((2, count, count, 16))
    weights[:, range(count), range(count)] = sine.reshape(count, 16), cosine.reshape(count, 16)
    local = graph.op("Gemm", angles, weights.reshape(2 * count, -1), still.reshape(-1))
    if count == 1:
        return graph.reshape(local, (-1, 1, 4, 4))
    shaped = graph.reshape(local, (-1, count, 4, 4))
    parts = graph.ops("Split", count, shaped, np.ones(count, np.int64), axis=1)
    for i in range(1, count):
        parts[i] = graph.op("MatMul", parts[i - 1], parts[i])
    return graph.concat(parts, axis=1)


def _screws(chain: Chain) -> np.ndarray:
    """(n, 16, 32): from a flat frame to the skew matrix of its axis, and to one with its origin as last column."""
    out = np.zeros((chain.joints, 4, 4, 2, 4, 4))
    for row in range(3):
        unit = np.eye(3)[row][None]
        for column in range(3):
            out[:, row, column, 0, :3, :3] = chain.axes[:, column, None, None] * skew_of(unit)[0]
        out[:, row, 3, 1, row, 3] = 1.0
    return out.reshape(chain.joints, 16, 32)


def _accelerations(graph: Graph, twists: str, count: int, qd: str | None, qdd: str | None) -> str | None:
    """V̇ + V²: (N, n, 4, 4); V̇_i = Σ_{k≤i} (Z_k q̈_k + [V_k, Z_k] q̇_k)."""
    below = graph.constant(np.tril(np.ones((count, count))))
    matrix, column = (-1, count, 4, 4), (-1, count, 1, 1)

    def accumulated(x: str) -> str:
        return graph.reshape(graph.op("MatMul", below, graph.reshape(x, (-1, count, 16))), matrix)

    driven = None if qdd is None else graph.op("Mul", twists, graph.reshape(qdd, column))
    if qd is None:
        return None if driven is None else accumulated(driven)
    own = graph.op("Mul", twists, graph.reshape(qd, column))
    velocity = accumulated(own)
    bracket = graph.op("Sub", graph.op("MatMul", velocity, own), graph.op("MatMul", own, velocity))
    change = bracket if driven is None else graph.op("Add", driven, bracket)
    return graph.op("Add", accumulated(change), graph.op("MatMul", velocity, velocity))
