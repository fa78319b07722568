"""A yaw-shoulder-elbow arm in closed form, with friction, drives and a supply of its own; no rigid-body library.

Joint 1 turns about the vertical, joints 2 and 3 about the y axis that turns along; at 0 both links point along x and
a positive angle lowers them. All centres of mass lie in the arm's vertical plane, so that the yaw axis is coupled to
the rest by the moment of inertia about the vertical alone (Lagrange's equations of that kinetic and potential energy).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from cellwatt.tables import write_table
from cellwatt_plugins.explain.fit.problem import Problem
from cellwatt_plugins.explain.fit.sides import torque_problem
from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.explain.input.run import Run, Simulated
from cellwatt_plugins.explain.model import Model, Prediction, predict_states
from cellwatt_plugins.robot import Arm as DescribedArm
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import Plan, exact
from tests.plugins.explain.logs import measured, numbered
from tests.plugins.explain.robot_file import write_arm

JOINTS = 3
G = 9.81
RATE = 100.0
TORQUE_NOISE = np.array([0.35, 0.45, 0.2])
POWER_NOISE = 1.5
ENCODER_NOISE = 2e-5
LAG = 0.002
"""s by which the arm follows its plan."""
TOLERANCES = {"friction": 0.1, "rotor_inertia": 0.05, "link": 0.05, "supply": 0.05}
"""What the description says of its own numbers."""


@dataclass(frozen=True)
class Arm:
    """All numbers of an arm; links along x, (axial, transverse) inertias about their centres."""

    column_inertia: float = 0.8
    """kg m² of the first link about the vertical."""
    length: float = 0.55
    """m from shoulder to elbow."""
    masses: tuple[float, float] = (7.5, 4.2)
    centres: tuple[float, float] = (0.24, 0.21)
    axial: tuple[float, float] = (0.03, 0.012)
    transverse: tuple[float, float] = (0.22, 0.09)
    coulomb: tuple[float, float, float] = (5.0, 7.0, 3.0)
    viscous: tuple[float, float, float] = (8.0, 9.0, 4.0)
    rotor: tuple[float, float, float] = (1.4, 1.6, 0.5)
    constant: tuple[float, float, float] = (11.0, 11.0, 7.0)
    resistance: tuple[float, float, float] = (0.6, 0.6, 1.1)
    standby: float = 90.0


NOMINAL = Arm()
REAL = replace(
    NOMINAL,
    masses=(7.35, 4.3),
    transverse=(0.225, 0.088),
    coulomb=(5.3, 6.7, 3.1),
    viscous=(7.8, 9.4, 3.9),
    rotor=(1.43, 1.57, 0.51),
    standby=91.5,
)
"""As it was built: each number a few per cent off what the simulation has."""

Course = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Position, velocity and acceleration (N, 3) at times (N,)."""


def loaded(arm: Arm, mass: float, reach: float) -> Arm:
    """With a point mass on the last link, ``reach`` m from the elbow."""
    own, centre = arm.masses[1], arm.centres[1]
    total = own + mass
    place = (own * centre + mass * reach) / total
    more = own * (centre - place) ** 2 + mass * (reach - place) ** 2
    return replace(
        arm,
        masses=(arm.masses[0], total),
        centres=(arm.centres[0], place),
        transverse=(arm.transverse[0], arm.transverse[1] + more),
    )


def inertia(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Mass matrix (N, 3, 3) kg m² of the links."""
    a, b = q[:, 1], q[:, 1] + q[:, 2]
    (m2, m3), (c2, c3), (x2, x3), (t2, t3) = arm.masses, arm.centres, arm.axial, arm.transverse
    out = np.zeros((len(q), 3, 3))
    radius = arm.length * np.cos(a) + c3 * np.cos(b)
    out[:, 0, 0] = (
        arm.column_inertia
        + (m2 * c2**2 + t2) * np.cos(a) ** 2
        + x2 * np.sin(a) ** 2
        + m3 * radius**2
        + t3 * np.cos(b) ** 2
        + x3 * np.sin(b) ** 2
    )
    coupling = m3 * arm.length * c3 * np.cos(q[:, 2])
    out[:, 1, 1] = t2 + t3 + m2 * c2**2 + m3 * (arm.length**2 + c3**2) + 2 * coupling
    out[:, 1, 2] = out[:, 2, 1] = t3 + m3 * c3**2 + coupling
    out[:, 2, 2] = t3 + m3 * c3**2
    return out


def _yaw_slopes(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Derivatives (N, 3) of the moment of inertia about the vertical by each angle."""
    a, b = q[:, 1], q[:, 1] + q[:, 2]
    (m2, m3), (c2, c3), (x2, x3), (t2, t3) = arm.masses, arm.centres, arm.axial, arm.transverse
    radius = arm.length * np.cos(a) + c3 * np.cos(b)
    outer = -2 * m3 * radius * c3 * np.sin(b) + (x3 - t3) * np.sin(2 * b)
    inner = (x2 - t2 - m2 * c2**2) * np.sin(2 * a) - 2 * m3 * radius * arm.length * np.sin(a)
    return np.column_stack([np.zeros(len(q)), inner + outer, outer])


def inertial(arm: Arm, link: int) -> list[float]:
    """Mass, first moment and moments of inertia about its joint of a moving link (0-based), by the parallel axes."""
    mass, centre, axial, transverse = arm.masses[link], arm.centres[link], arm.axial[link], arm.transverse[link]
    across = transverse + mass * centre**2
    return [mass, mass * centre, 0, 0, axial, 0, across, 0, 0, across]


def links(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torque (N, 3) Nm that the links need."""
    slopes = _yaw_slopes(arm, q)
    bend = arm.masses[1] * arm.length * arm.centres[1] * np.sin(q[:, 2])
    out = np.einsum("nij,nj->ni", inertia(arm, q), qdd)
    out[:, 0] += qd[:, 0] * np.sum(slopes * qd, axis=1)
    out[:, 1:] -= 0.5 * slopes[:, 1:] * qd[:, :1] ** 2
    out[:, 1] -= bend * (2 * qd[:, 1] * qd[:, 2] + qd[:, 2] ** 2)
    out[:, 2] += bend * qd[:, 1] ** 2
    lower = -G * arm.masses[1] * arm.centres[1] * np.cos(q[:, 1] + q[:, 2])
    upper = -G * (arm.masses[0] * arm.centres[0] + arm.masses[1] * arm.length) * np.cos(q[:, 1])
    out[:, 1] += upper + lower
    out[:, 2] += lower
    return out


def motors(arm: Arm, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Motor torque (N, 3) Nm: links, rotors and friction."""
    return links(arm, q, qd, qdd) + np.array(arm.rotor) * qdd + arm.coulomb * turned(qd) + arm.viscous * qd


def turned(qd: np.ndarray) -> np.ndarray:
    """Sign of the velocity, turning over within 4 mrad/s as in the law that the simulation states."""
    return 2 / (1 + np.exp(-np.clip(qd / 0.002, -500, 500))) - 1


def heat(arm: Arm, torque: np.ndarray) -> np.ndarray:
    """Copper loss (N, 3) W."""
    return np.array(arm.resistance) * (torque / np.array(arm.constant)) ** 2


def draw(arm: Arm, torque: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Supply power (N,) W."""
    return arm.standby + np.sum(torque * qd + heat(arm, torque), axis=1)


def moves(seed: int, seconds: float, pause: float = 0.5) -> Course:
    """From point to point, each joint in its own time, slow and fast, with rests; in closed form."""
    random = np.random.default_rng(seed)
    starts, durations, points = [], [], [random.uniform(-0.5, 0.5, JOINTS)]
    at = 0.6
    while at < seconds:
        points.append(random.uniform([-1.4, -1.1, -0.4], [1.4, 0.5, 1.6]))
        fastest = random.choice([0.4, 1.0, 2.0]) * random.uniform(0.7, 1.0, JOINTS)
        durations.append(np.maximum(0.8, 1.875 * np.abs(points[-1] - points[-2]) / fastest))
        starts.append(at)
        at += float(np.max(durations[-1])) + pause

    return lambda time: travelled(time, starts, durations, points)


def travelled(
    time: np.ndarray, starts: Iterable[float], durations: Iterable[np.ndarray | float], points: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration (N, n) from point to point (quintic), at rest before, between and after."""
    q = np.tile(points[0], (len(time), 1))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for start, lasts, (here, there) in zip(starts, durations, pairwise(points), strict=False):
        s = np.clip((time[:, None] - start) / lasts, 0, 1)
        way = there - here
        q += way * (10 * s**3 - 15 * s**4 + 6 * s**5)
        qd += way * (30 * s**2 - 60 * s**3 + 30 * s**4) / lasts
        qdd += way * (60 * s - 180 * s**2 + 120 * s**3) / lasts**2
    return q, qd, qdd


@dataclass(frozen=True)
class Missing:
    """What the real arm has and the simulation does not."""

    arm: Arm = REAL
    added: Callable[[np.ndarray, np.ndarray, np.ndarray, str], np.ndarray] = field(
        default=lambda time, q, qd, run: np.zeros_like(q)
    )
    """Torque (N, 3) Nm at the motors, from time, position, velocity and the run's name."""
    read: Callable[[np.ndarray], np.ndarray] = field(default=lambda torque: torque)
    """What the measurement makes of the torque."""
    delay: float = 0.0
    """s by which the measured torque is late."""
    drawn: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] = field(default=lambda time, power, qd: power)
    """Supply power from time, power without the effect, and velocity."""


NOTHING = Missing()


def record(
    name: str,
    seed: int,
    missing: Missing = NOTHING,
    seconds: float = 24.0,
    plan: bool = True,
    power: bool = True,
    along: Course | None = None,
) -> Run:
    """A noisy recording of the real arm with what the simulation says of its plan, ``along`` a course of its own."""
    random = np.random.default_rng(1000 + seed)
    time = np.arange(round(seconds * RATE)) / RATE
    course = along or moves(seed, seconds)

    def needed(when: np.ndarray) -> np.ndarray:
        q, qd, qdd = course(when - LAG)
        return motors(missing.arm, q, qd, qdd) + missing.added(when, q, qd, name)

    q, qd, _ = course(time - LAG)
    torque = missing.read(needed(time - missing.delay))
    supply = missing.drawn(time, draw(missing.arm, needed(time), qd), qd)
    return Run(
        name=name,
        time=time,
        position=q + ENCODER_NOISE * random.standard_normal(q.shape),
        velocity=qd + 2e-3 * random.standard_normal(q.shape),
        torque=torque + TORQUE_NOISE * random.standard_normal(torque.shape),
        power=supply + POWER_NOISE * random.standard_normal(len(time)) if power else None,
        plan=Plan(*course(time)) if plan else None,
        simulated=simulated(course, time) if plan else None,
    )


def simulated(course: Course, time: np.ndarray, arm: Arm = NOMINAL, more: np.ndarray | float = 0.0) -> Simulated:
    """What the simulation of an arm says of the commanded motion; ``more`` Nm on top."""
    q, qd, qdd = course(time)
    torque = motors(arm, q, qd, qdd) + more
    return Simulated(time, Plan(q, qd, qdd), torque, draw(arm, torque, qd))


def write_robot(folder: Path, **changes: object) -> Path:
    """The nominal arm as URDF and ``robot.yaml``; ``changes`` are the same for every joint, or keys of the robot."""
    arm = NOMINAL
    sizes = [(0.01, 0.01, arm.column_inertia), *((x, t, t) for x, t in zip(arm.axial, arm.transverse, strict=True))]
    links = list(zip((f"{x} 0 0" for x in (0.0, *arm.centres)), (10.0, *arm.masses), sizes, strict=True))
    joints = (("0 0 1", "0 0 0.4"), ("0 1 0", "0 0 0"), ("0 1 0", f"{arm.length} 0 0"))
    drives = (JOINTS * (81.0,), arm.constant, arm.rotor, arm.coulomb, arm.viscous, arm.resistance)
    limit = 'lower="-3.1" upper="3.1" effort="400" velocity="8"'
    content = {"standby_power": arm.standby, "tolerances": TOLERANCES}
    return write_arm(folder, "plant", links, joints, limit, drives, content, changes)


def load(path: Path) -> DescribedArm:
    """The description and its dynamics, as the code under test reads them."""
    return DescribedArm.load(path)


def states(arm: DescribedArm, seed: int = 1, seconds: float = 8.0, index: int = 0, still: bool = False) -> States:
    """The arm along an exactly known motion; ``still``: at rest throughout."""
    time = np.arange(round(seconds * RATE)) / RATE
    q, qd, qdd = moves(seed, seconds)(time)
    if still:
        q, qd, qdd = np.tile(q[0], (len(q), 1)), np.zeros_like(qd), np.zeros_like(qdd)
    return States(f"run_{index + 1:02d}", index, time, exact(q, qd, qdd), arm)


def states_of(runs: Sequence[Run], arm: DescribedArm) -> list[States]:
    """The arm along the motions that were recorded."""
    return [States(run.name, i, run.time, moved(run), arm) for i, run in enumerate(runs)]


def problem_of(
    arm: DescribedArm, missing: Missing = NOTHING, seconds: float = 24.0, seeds: Sequence[int] = (1, 2)
) -> Problem:
    """The joints' torques in recordings of the real arm."""
    runs = [record(f"run_{seed:02d}", seed, missing, seconds, power=False) for seed in seeds]
    return torque_problem(runs, states_of(runs, arm))


def column(values: np.ndarray, joint: int) -> np.ndarray:
    """Values (N,) at one joint (1-based), 0 at the others: (N, 3)."""
    return np.outer(values, np.eye(JOINTS)[joint - 1])


def write(folder: Path, run: Run) -> None:
    """The run's recording and its simulation as files, under the names that the contract gives them."""
    said = run.simulated
    assert said is not None
    table = {"t": said.time, **numbered("q", said.plan.position), **numbered("qd", said.plan.velocity)}
    table |= {**numbered("qdd", said.plan.acceleration), **numbered("tau", said.torque), "power": said.power}
    write_table(folder / f"{run.name}.recording.parquet", measured(run))
    write_table(folder / f"{run.name}.simulation.parquet", table)


def predict(model: Model, time: np.ndarray, *motion: np.ndarray) -> Prediction:
    """What a model says of a motion (position, velocity, acceleration) that begins at rest."""
    return predict_states(model, States("motion", -1, time, exact(*motion), model.baseline.recorded))
