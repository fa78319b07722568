"""An arm's URDF and robot.yaml from plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

DRIVES = (
    "gear_ratio",
    "torque_constant",
    "rotor_inertia",
    "coulomb_friction",
    "viscous_friction",
    "winding_resistance",
)

Link = tuple[str, float, tuple[float, float, float]]
"""Centre of mass, mass, and inertias about its axes."""


def write_arm(
    folder: Path,
    name: str,
    links: Sequence[Link],
    joints: Sequence[tuple[str, str]],
    limit: str,
    drives: Sequence[Sequence[float]],
    content: Mapping[str, object],
    changes: Mapping[str, object],
) -> Path:
    """Write links, joints of (axis, origin) and each of ``DRIVES``, one value a joint; gives ``robot.yaml``.

    ``changes`` are the same for every joint, or other ``content`` of the robot.
    """
    rows = [f'<robot name="{name}"><link name="base"/>']
    for i, ((centre, mass, (x, y, z)), (axis, origin)) in enumerate(zip(links, joints, strict=True), start=1):
        rows.append(
            f'<link name="link_{i}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
            f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="axis_{i}" type="revolute"><parent link="{f"link_{i - 1}" if i > 1 else "base"}"/>'
            f'<child link="link_{i}"/><origin xyz="{origin}"/><axis xyz="{axis}"/><limit {limit}/></joint>'
        )
    (folder / f"{name}.urdf").write_text("\n".join([*rows, "</robot>"]))
    own = {key: value for key, value in changes.items() if key in DRIVES}
    described = [
        {"name": f"axis_{i}", **dict(zip(DRIVES, map(float, values), strict=True)), **own}
        for i, values in enumerate(zip(*drives, strict=True), start=1)
    ]
    whole = {"robot": name, "urdf": f"{name}.urdf", **content, **changes, "joints": described}
    text = yaml.safe_dump({key: value for key, value in whole.items() if key not in own})
    (folder / "robot.yaml").write_text(text)
    return folder / "robot.yaml"
