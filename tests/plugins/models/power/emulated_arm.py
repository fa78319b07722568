"""Arms that exist nowhere else: moves, currents and supply power from plain Newton–Euler.

Shares no code with what is tested: links are those of ``bench/energy/chain.py``. What a user knows is written beside as
``robot.yaml`` and URDF, with links some per cent off.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from energy.chain import Link
from energy.chain import torques as torques_of


@dataclass(frozen=True)
class Arm:
    """Six or seven joints with z axes; all arrays by joint."""

    offsets: np.ndarray
    """(n, 3) m: the joint's origin in the link before."""
    turns: np.ndarray
    """(n,) rad: the link before is turned about x by this."""
    mass: np.ndarray
    centre: np.ndarray
    """(n, 3) m."""
    inertia: np.ndarray
    """(n, 3) kg m²: principal moments about the centre of mass."""
    rotor: np.ndarray
    constant: np.ndarray
    resistance: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    stribeck: np.ndarray
    stribeck_speed: float = 0.1
    cubic: np.ndarray = field(default_factory=lambda: np.zeros(7))
    by_load: np.ndarray = field(default_factory=lambda: np.zeros(7))
    asymmetry: np.ndarray = field(default_factory=lambda: np.zeros(7))
    spring: np.ndarray = field(default_factory=lambda: np.zeros(7))
    ripple: np.ndarray = field(default_factory=lambda: np.zeros(7))
    """Nm · tanh(4 (q − 0.3)): of a hose that turns over, which no term is for."""
    payload: float = 0.0
    """kg at the flange that the user does not know of."""
    width: float = 0.004
    standby: float = 80.0
    efficiency: float = 0.88
    used: float = 0.0
    """Share of returned energy that is used."""
    each_burns: bool = False
    iron: float = 0.0
    brakes: float = 0.0
    power_noise: float = 0.7
    current_noise: float = 0.012
    """Share of the current's spread."""
    position_noise: float = 2e-5
    velocity_noise: float = 2.5e-3
    rate: float = 125.0

    @property
    def joints(self) -> int:
        return len(self.mass)


def turn_x(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def links_of(arm: Arm) -> tuple[list[Link], np.ndarray]:
    """The links in frames that are all parallel at zero, and how the last one's own frame is turned to these."""
    turned, out = np.eye(3), []
    for i, angle in enumerate(arm.turns):
        origin = turned @ arm.offsets[i]
        turned = turned @ turn_x(angle)
        inertia = np.abs(turned) @ arm.inertia[i]  # by right angles alone
        out.append(Link(origin, turned[:, 2], arm.mass[i], turned @ arm.centre[i], inertia))
    return out, turned


def torques(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque of the links, and of the whole drive, (N, n) Nm."""
    links, turned = links_of(arm)
    n, out = arm.joints, torques_of(links, q, qd, qdd, arm.payload, turned @ [0.0, 0.0, 0.08])
    s = np.tanh(qd / arm.width)
    excess = arm.stribeck * np.exp(-((qd / arm.stribeck_speed) ** 2))
    friction = (arm.coulomb + excess + arm.by_load[:n] * np.abs(out)) * s + arm.viscous * qd + arm.cubic[:n] * qd**3
    friction = friction + arm.asymmetry[:n] * np.abs(s) + arm.spring[:n] * q + arm.ripple[:n] * np.tanh(4 * (q - 0.3))
    return out, out + arm.rotor * qdd + friction


def supply(arm: Arm, torque: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """(N,) W."""
    current = torque / arm.constant
    each = torque * qd + arm.resistance * current**2 + arm.iron * np.abs(qd)
    flow = each if arm.each_burns else each.sum(axis=1, keepdims=True)
    flow = np.where(flow > 0, flow / arm.efficiency, flow * arm.used / arm.efficiency).sum(axis=1)
    return arm.standby + flow + arm.brakes * (np.abs(qd).max(axis=1) > 0.01)


def course(arm: Arm, draw: np.random.Generator, count: int, speeds: tuple[float, float]) -> dict[str, np.ndarray]:
    """Moves from a few starts to random targets, at rest before and after: t, move, q, qd, qdd without noise."""
    n, step = arm.joints, 1 / arm.rate
    starts = draw.uniform(-1.5, 1.5, (max(1, count // 8), n)) + np.array([0, -1.0, *[0] * (n - 2)])
    parts: dict[str, list[np.ndarray]] = {"move": [], "q": [], "qd": [], "qdd": []}
    for k in range(count):
        way = draw.uniform(-2.2, 2.2, n)
        fastest = draw.uniform(*speeds)
        time = max(0.5, float(np.abs(way).max() * 1.875 / fastest))
        t = np.arange(-0.4, time + 0.4, step)
        u = np.clip(t / time, 0, 1)
        shape = u**3 * (10 - 15 * u + 6 * u**2)
        slope = 30 * u**2 * (1 - u) ** 2 / time
        bend = 60 * u * (1 - u) * (1 - 2 * u) / time**2
        parts["q"].append(starts[k * len(starts) // count] + shape[:, None] * way)
        parts["qd"].append(slope[:, None] * way)
        parts["qdd"].append(bend[:, None] * way)
        parts["move"].append(np.full(len(t), k))
    out = {name: np.concatenate(values) for name, values in parts.items()}
    out["t"] = np.arange(len(out["move"])) * step
    return out


def recorded(arm: Arm, draw: np.random.Generator, count: int, speeds: tuple[float, float]) -> pa.Table:
    """The table that a user would have: t, move, q_i, qd_i, current_i, power."""
    true = course(arm, draw, count, speeds)
    _, torque = torques(arm, true["q"], true["qd"], true["qdd"])
    current = torque / arm.constant
    noise = lambda size, shape: size * draw.normal(size=shape)  # noqa: E731
    columns: dict[str, np.ndarray] = {"t": true["t"], "move": true["move"]}
    seen = {
        "q": true["q"] + noise(arm.position_noise, current.shape),
        "qd": true["qd"] + noise(arm.velocity_noise, current.shape),
        "current": current + noise(1.0, current.shape) * arm.current_noise * current.std(axis=0),
    }
    for name, values in seen.items():
        columns |= {f"{name}_{i + 1}": values[:, i] for i in range(arm.joints)}
    power = supply(arm, torque, true["qd"])
    columns["power"] = power + noise(arm.power_noise, power.shape)
    return pa.table(columns)


def six_axes(draw: np.random.Generator) -> Arm:
    """About a UR5."""
    offsets = [[0, 0, 0.09], [0, 0, 0], [0.42, 0, 0], [0.39, 0, 0.11], [0, -0.09, 0], [0, 0.08, 0]]
    size = np.array([30.0, 45.0, 25.0, 6.0, 5.0, 3.0])
    return Arm(
        offsets=np.array(offsets, float),
        turns=np.array([0, np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2]),
        mass=np.array([3.7, 8.4, 2.3, 1.2, 1.2, 0.2]) * draw.uniform(0.9, 1.1, 6),
        centre=np.array([[0, -0.02, 0], [0.21, 0, 0.11], [0.18, 0, 0.02], [0, 0, 0], [0, 0, 0], [0, 0, -0.01]], float),
        inertia=np.array([3 * [0.01], [0.02, 0.2, 0.2], [0.01, 0.05, 0.05], *3 * [3 * [0.002]]], float),
        rotor=np.array([2.0, 2.3, 1.9, 0.4, 0.3, 0.3]),
        constant=np.array([13.0, 12.0, 12.5, 9.0, 9.2, 9.4]),
        resistance=np.array([0.6, 0.55, 0.65, 1.4, 1.3, 1.5]),
        coulomb=0.2 * size * draw.uniform(0.6, 1.4, 6),
        viscous=0.25 * size * draw.uniform(0.6, 1.4, 6),
        stribeck=0.08 * size * draw.uniform(0, 1, 6),
        stribeck_speed=float(draw.uniform(0.05, 0.2)),
    )


def seven_axes(draw: np.random.Generator) -> Arm:
    """About a Panda, whose drives each burn what they get back."""
    h = np.pi / 2
    offsets = [[0, 0, 0.33], [0, 0, 0], [0, -0.32, 0], [0.08, 0, 0], [-0.08, 0.38, 0], [0, 0, 0], [0.09, 0, 0]]
    size = np.array([25.0, 40.0, 20.0, 18.0, 5.0, 4.0, 2.0])
    return Arm(
        offsets=np.array(offsets, float),
        turns=np.array([0, -h, h, h, -h, h, h]),
        mass=np.array([4.9, 3.5, 3.2, 3.6, 1.2, 1.6, 0.8]) * draw.uniform(0.9, 1.1, 7),
        centre=draw.normal(0, 0.03, (7, 3))
        + np.array([[0, -0.03, -0.1], *[[0, -0.05, 0.02]] * 3, *[[0, 0.02, 0]] * 3]),
        inertia=np.array([[0.03, 0.03, 0.01]] * 4 + [[0.01, 0.008, 0.006]] * 3),
        rotor=np.array([0.9, 0.9, 0.8, 0.8, 0.3, 0.3, 0.2]),
        constant=np.array([15.0, 15.0, 14.0, 14.0, 7.0, 7.0, 7.0]),
        resistance=np.array([0.8, 0.8, 0.8, 0.8, 1.8, 1.8, 1.8]),
        coulomb=0.15 * size * draw.uniform(0.5, 1.5, 7),
        viscous=0.2 * size * draw.uniform(0.5, 1.5, 7),
        stribeck=0.0 * size,
        by_load=0.06 * draw.uniform(0, 1, 7),
        each_burns=True,
        iron=2.0,
        standby=60.0,
        rate=100.0,
    )


def burdened(draw: np.random.Generator) -> Arm:
    """Six axes with a hose, a tool that nobody wrote down, friction by direction; a supply that takes energy back."""
    return replace(
        six_axes(draw),
        payload=1.5,
        spring=np.array([2.0, 0, 3.0, 0, 0, 0, 0]),
        asymmetry=np.array([0, 2.0, 0, 0.4, 0, 0, 0]),
        cubic=np.array([1.5, 0, 1.0, 0, 0, 0.2, 0]),
        used=0.8,
        brakes=4.0,
        width=0.008,
        standby=120.0,
        power_noise=1.2,
    )


def rippled(draw: np.random.Generator) -> Arm:
    """Six axes with hoses that turn over, which no term is for."""
    return replace(six_axes(draw), ripple=np.array([3.0, 4.0, 2.0, 0.5, 0.5, 0.3, 0]))


ARMS = {"six axes": six_axes, "seven axes": seven_axes, "burdened": burdened, "rippled": rippled}


def write_known(arm: Arm, folder: Path, draw: np.random.Generator) -> Path:
    """``robot.yaml`` and ``robot.urdf`` as the user has them: links off by 3 %, no friction, no standby power."""
    folder.mkdir(parents=True, exist_ok=True)
    text = ['<robot name="arm"><link name="link_0"/>']
    for i in range(arm.joints):
        mass = arm.mass[i] * (1 + 0.03 * draw.normal())
        centre = arm.centre[i] * (1 + 0.03 * draw.normal())
        xx, yy, zz = arm.inertia[i] * (1 + 0.03 * draw.normal())
        text.append(
            f'<link name="link_{i + 1}"><inertial><origin xyz="{centre[0]} {centre[1]} {centre[2]}"/>'
            f'<mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
            f'</link><joint name="joint_{i + 1}" type="revolute"><parent link="link_{i}"/><child link="link_{i + 1}"/>'
            f'<origin xyz="{arm.offsets[i][0]} {arm.offsets[i][1]} {arm.offsets[i][2]}" rpy="{arm.turns[i]} 0 0"/>'
            '<axis xyz="0 0 1"/><limit lower="-6" upper="6" effort="1" velocity="9"/></joint>'
        )
    (folder / "robot.urdf").write_text("\n".join([*text, "</robot>"]))
    keys = {"torque_constant": arm.constant, "rotor_inertia": arm.rotor, "winding_resistance": arm.resistance}
    joints = [
        {"name": f"joint_{i + 1}"} | {key: float(values[i]) for key, values in keys.items()} for i in range(arm.joints)
    ]
    file = folder / "robot.yaml"
    file.write_text(yaml.safe_dump({"robot": "arm", "urdf": "robot.urdf", "joints": joints}))
    return file


def write_case(folder: Path, kind: str, seed: int, moves: int = 80, unseen: int = 40) -> tuple[Path, Path, Path]:
    """A whole case: robot.yaml, training table, and a table of faster and slower moves."""
    draw = np.random.default_rng(seed)
    arm = ARMS[kind](draw)
    robot = write_known(arm, folder, draw)
    pq.write_table(recorded(arm, draw, moves, (0.5, 1.6)), folder / "train.parquet")
    pq.write_table(recorded(arm, draw, unseen, (0.3, 2.2)), folder / "test.parquet")
    return robot, folder / "train.parquet", folder / "test.parquet"
