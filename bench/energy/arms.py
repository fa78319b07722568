"""The arms of the benchmark: kinematics, motors and habits drawn from a seed, none of them one of the judged files."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .chain import Link

SPEEDS = (50.0, 100.0, 150.0, 200.0, 250.0, 700.0, 1400.0)


@dataclass(frozen=True)
class Case:
    """One arm and how it is measured."""

    name: str
    seed: int
    joints: int = 6
    size: float = 1.0
    """Lengths against an arm of 0.85 m reach; masses go with the square."""
    payload: float = 5.0
    current: bool = True
    """Torque estimated from current, off by a factor a joint; otherwise measured."""
    gains: tuple[float, float] = (0.85, 1.15)
    sensor: float = 0.0
    """Share by which measured torque is off, one standard deviation a joint."""
    gear: float = 1.0
    """Gear friction against that of harmonic drives."""
    brakes: float = 5.0
    """W; 0: none."""
    separate: bool = True
    speeds: tuple[float, ...] = SPEEDS
    profile: str = "quintic"
    """How a leg is timed: quintic, septic or trapezoid."""
    rate: float = 100.0
    """Hz of the robot's recording."""
    returned: float = 0.5
    noise: float = 0.08
    """W of the analyzer, a value."""
    drift: float = 0.0
    """W by which the electronics differ from run to run, one standard deviation."""
    heating: float = 0.0
    """Rise of winding resistance in the heaviest run, as a share."""
    repetitions: int = 4
    rest: float = 1.0
    meter: float = 0.0
    """Share by which the analyzer reads too much."""
    stray: tuple[float, float] = (0.0, 1.5)
    """Stray losses k I^x, of which the product has no term: their share of the copper losses at 3 A, and x."""


@dataclass(frozen=True)
class Truth:
    """The arm itself, and what its user knows of it."""

    links: tuple[Link, ...]
    known: tuple[Link, ...]
    rotor: np.ndarray
    known_rotor: np.ndarray
    constant: np.ndarray
    resistance: np.ndarray
    known_resistance: np.ndarray
    switching: float
    iron: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    gains: np.ndarray
    tool: tuple[float, float, float]


CASES = (
    Case("ur_like", 1),
    Case("ur_big", 2, size=1.5, payload=10.0, returned=0.3, brakes=7.0),
    Case("ur_small", 3, size=0.6, payload=3.0, gains=(0.7, 0.95), returned=0.7),
    Case("franka_like", 4, joints=7, payload=3.0, current=False, gear=0.2, brakes=18.0, returned=0.35),
    Case("gen3_like", 5, joints=7, payload=4.0, current=False, gear=0.5, brakes=0.0, separate=False, returned=0.6),
    Case("seven_by_current", 6, joints=7, payload=7.0, gear=1.3, profile="septic"),
    Case("trapezoid_500_hz", 7, profile="trapezoid", rate=500.0, repetitions=3),
    Case("nothing_returned", 8, returned=0.0, gear=0.6),
    Case("all_returned", 9, joints=7, current=False, returned=1.0, payload=3.0, gear=0.3),
    Case("slow_only", 10, speeds=SPEEDS[:5], gains=(0.85, 0.98)),
    Case("noisy_drifting", 11, noise=0.3, drift=0.15, heating=0.05, payload=6.0),
    Case("sensor_noisy", 12, joints=6, current=False, gear=0.3, noise=0.3, drift=0.1, payload=4.0, profile="septic"),
    Case("stray_losses", 1, stray=(0.3, 1.5)),
)


def make_arm(case: Case) -> Truth:
    """Draw the arm of a case."""
    rng = np.random.default_rng(case.seed)
    known = _links(case, rng)
    links = tuple(_real(link, rng) for link in known)
    n = case.joints
    big = np.array([1.0, 1.0, 1.0, *([0.45] * (n - 3))]) * case.size**2
    rotor = 2.2 * big * rng.uniform(0.6, 1.0, n) * (1.0 if case.current else 0.3)
    constant = (11.0 if case.current else 5.0) * np.sqrt(big) * rng.uniform(0.9, 1.1)
    known_resistance = np.where(big > 0.6 * big.max(), 0.6, 1.3)
    effective = rng.uniform(0.3, 0.8) if case.current else rng.uniform(0.1, 0.3)
    resistance = known_resistance * effective * rng.normal(1, 0.06, n)
    friction = case.gear * big
    return Truth(
        links=links,
        known=known,
        rotor=rotor * rng.normal(1, 0.03, n),
        known_rotor=rotor,
        constant=constant,
        resistance=resistance,
        known_resistance=known_resistance,
        switching=rng.uniform(0.1, 0.6),
        iron=rng.uniform(0.1, 0.6) * rng.normal(1, 0.2, n).clip(0.3),
        coulomb=5.0 * friction * rng.uniform(0.7, 1.3, n),
        viscous=7.0 * friction * rng.uniform(0.7, 1.3, n),
        gains=rng.uniform(*case.gains, n) if case.current else _sensors(case),
        tool=(0.0, 0.03 * rng.uniform(-1, 1), 0.06),
    )


def _sensors(case: Case) -> np.ndarray:
    return 1.0 + case.sensor * np.random.default_rng([case.seed, 13]).standard_normal(case.joints)


def _links(case: Case, rng: np.random.Generator) -> tuple[Link, ...]:
    """Shoulder, elbow and wrist about z, y, y(, z), y, x, …, with lengths that differ from arm to arm."""
    a, b = (case.size * v for v in rng.uniform([0.36, 0.32], [0.46, 0.42]))
    off = case.size * rng.uniform(0.05, 0.12, 4)
    m = case.size**2
    body = [
        Link((0, 0, 0.15 * case.size), (0, 0, 1), 3.7 * m, (0, 0, -0.02), rod(3.7 * m, 0.15, 2)),
        Link((0, off[0], 0), (0, 1, 0), 8.0 * m, (a / 2, 0, 0), rod(8.0 * m, a, 0)),
        Link((a, -off[1], 0), (0, 1, 0), 2.6 * m, (b / 2, 0, 0), rod(2.6 * m, b, 0)),
        Link((b, off[2], 0), (0, 1, 0), 1.3 * m, (0, 0.02, 0.01), rod(1.3 * m, 0.1, 1)),
        Link((0.05, off[3], 0), (0, 0, 1), 1.2 * m, (0, 0, 0.02), rod(1.2 * m, 0.1, 2)),
        Link((0, 0, 0.09), (1, 0, 0), 0.5 * m, (0.03, 0, 0), rod(0.5 * m, 0.08, 0)),
    ]
    if case.joints == 7:
        body.insert(2, Link((a * 0.9, 0.02, 0), (1, 0, 0), 1.8 * m, (0.05, 0, 0.01), rod(1.8 * m, 0.15, 0)))
        body[3] = replace(body[3], origin=(a * 0.1, -off[1], 0.03))
    return tuple(body)


def rod(mass: float, length: float, along: int) -> tuple[float, float, float]:
    thick, thin = mass * (length**2 / 12 + 0.001), mass * 0.002
    return tuple(thin if i == along else thick for i in range(3))


def _real(link: Link, rng: np.random.Generator) -> Link:
    """A link as built: masses, centres and inertias some per cent off."""
    f = rng.normal(1, 0.03, 3)
    centre = tuple(float(c * f[1]) for c in link.centre)
    return replace(link, mass=link.mass * f[0], centre=centre, inertia=tuple(i * f[2] for i in link.inertia))
