"""The rigid-body dynamics inside a model file against Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pinocchio as pin
import pytest

from cellwatt_plugins.models.dynamics import inverse_dynamics
from cellwatt_plugins.onnx_graph import Graph, Tensor
from cellwatt_plugins.robot import Body
from tests.plugins.models.making import run_graph


def written_arm(folder: Path, joints: int, seed: int) -> Body:
    """An arm with random axes, placements and links."""
    draw = np.random.default_rng(seed)
    text = ['<robot name="arm"><link name="link_0"/>']
    for i in range(1, joints + 1):
        m, c, size = draw.uniform(0.5, 9), draw.normal(0, 0.1, 3), draw.uniform(0.01, 0.2, 3)
        xx, yy, zz = size[1] + size[2], size[0] + size[2], size[0] + size[1]
        axis = draw.normal(size=3)
        text.append(
            f'<link name="link_{i}"><inertial><origin xyz="{c[0]} {c[1]} {c[2]}" rpy="0.3 -0.2 0.9"/>'
            f'<mass value="{m}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="joint_{i}" type="revolute"><parent link="link_{i - 1}"/><child link="link_{i}"/>'
            f'<origin xyz="{" ".join(map(str, draw.normal(0, 0.3, 3)))}" '
            f'rpy="{" ".join(map(str, draw.uniform(-3, 3, 3)))}"/>'
            f'<axis xyz="{" ".join(map(str, axis / np.linalg.norm(axis)))}"/>'
            f'<limit lower="-6" upper="6" effort="1" velocity="1"/></joint>'
        )
    file = folder / "arm.urdf"
    file.write_text("\n".join([*text, "</robot>"]))
    return Body(file, tuple(f"joint_{i}" for i in range(1, joints + 1)))


def motion(joints: int) -> np.ndarray:
    draw, shape = np.random.default_rng(5), (40, joints)
    return np.hstack([draw.uniform(-3, 3, shape), draw.normal(0, 2, shape), draw.normal(0, 9, shape)])


def split(joints: int) -> tuple[Graph, list[Tensor]]:
    """A graph of positions, velocities and accelerations, and each of the three."""
    graph = Graph(columns=3 * joints)
    return graph, graph.input.split([joints] * 3, axis=-1)


@pytest.mark.parametrize("joints", [1, 2, 6, 7])
def test_torques_are_those_of_pinocchio(tmp_path, joints):
    body = written_arm(tmp_path, joints, seed=joints)
    values = motion(joints)
    graph, given = split(joints)
    torque = run_graph(graph, inverse_dynamics(body, *given), joints, values)
    model = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    expected = np.stack([pin.rnea(model, model.createData(), *np.split(row, 3)) for row in values])
    assert np.abs(torque - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())


def test_what_is_left_out_is_zero(tmp_path):
    body = written_arm(tmp_path, 6, seed=1)
    values = motion(6)
    q, qd, qdd = np.split(values, 3, axis=1)
    still = np.zeros_like(q)
    for absent, expected in (
        ([2], body.inverse_dynamics(q, qd, still)),
        ([1], body.inverse_dynamics(q, still, qdd)),
        ([1, 2], body.gravity(q)),
    ):
        graph, given = split(6)
        torque = inverse_dynamics(body, *(None if i in absent else given[i] for i in range(3)))
        assert np.abs(run_graph(graph, torque, 6, values) - expected).max() < 1e-8


def test_a_frame_costs_few_nodes(tmp_path):
    """What a frame costs is the number of nodes: about 1 µs each."""
    graph, given = split(6)
    file = graph.model([inverse_dynamics(written_arm(tmp_path, 6, seed=3), *given)], 6)
    assert len(onnx.load_from_string(file).graph.node) < 60
