"""Serial arms of six and seven axes, drawn at random around five kinds of cell robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from concealed.families import FAMILIES

Array = NDArray[Any]


@dataclass(frozen=True)
class Arm:
    """One arm of n joints; lengths in m, masses in kg, all joint figures at the joint side (Nm, rad).

    `inertia` is the diagonal about the centre of mass in axes parallel to the link frame; `noise` is the standard
    deviation of the measured torque and `power_noise` that of the supply meter.
    """

    family: str
    axes: Array
    origins: Array
    flange: Array
    mass: Array
    com: Array
    inertia: Array
    rotor: Array
    coulomb: Array
    viscous: Array
    constant: Array
    resistance: Array
    gear: Array
    standby: float
    low: Array
    high: Array
    speed: Array
    acceleration: Array
    noise: Array
    power_noise: float
    rated_payload: float

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.mass)


def draw_arm(rng: np.random.Generator, family: str) -> Arm:
    """An arm of the family with its own lengths, masses, drives and sensors; every figure the plant's truth."""
    f = FAMILIES[family]
    n = len(f.mass)
    about = lambda values, spread: np.asarray(values, float) * rng.uniform(1 - spread, 1 + spread, n)  # noqa: E731
    size = rng.uniform(0.85, 1.18)
    mass = about(f.mass, 0.12) * size**2
    com = np.asarray(f.com, float) * size * rng.uniform(0.85, 1.15, (n, 3)) + rng.normal(0, 0.004, (n, 3)) * size
    drive = rng.uniform(0.8, 1.25)
    rotor, coulomb, viscous = (
        about(f.rotor, 0.1) * size**2,
        about(f.coulomb, 0.2) * drive,
        about(f.viscous, 0.2) * drive,
    )
    noise, pace = about(f.noise, 0.25) * size**2, rng.uniform(0.8, 1.1)
    middle = np.asarray(f.middle, float)
    return Arm(
        family,
        np.asarray(f.axes, float),
        np.asarray(f.origins, float) * size * rng.uniform(0.93, 1.07, (n, 1)),
        np.asarray(f.flange, float) * size,
        mass,
        com,
        link_inertia(mass, com, about(f.radius, 0.1) * size),
        rotor,
        coulomb,
        viscous,
        about(f.constant, 0.1),
        about(f.resistance, 0.15),
        about(np.full(n, f.gear), 0.0),
        f.standby * rng.uniform(0.8, 1.25),
        middle - f.reach,
        middle + f.reach,
        about(f.speed, 0.08) * pace,
        about(f.acceleration, 0.1) * pace**2,
        noise,
        f.power_noise * rng.uniform(0.7, 1.3),
        f.rated_payload * size,
    )


def link_inertia(mass: Array, com: Array, radius: Array) -> Array:
    """(n, 3) diagonal about the centre of mass of a solid cylinder that reaches twice as far as the centre of mass."""
    extent = np.stack([np.maximum(2 * np.abs(c), r) for c, r in zip(com, radius, strict=True)])
    squares = (extent**2) / 12.0 + (radius**2 / 4.0)[:, None]
    return np.stack([mass * (squares[:, (k + 1) % 3] + squares[:, (k + 2) % 3]) / 1.5 for k in range(3)], axis=1)


def mistune(rng: np.random.Generator, arm: Arm, share: float = 1.0) -> Arm:
    """What somebody believes of the arm: every figure off by a few per cent, none missing.

    `share` scales all deviations; 1 is the simulation's, smaller the controller's own model.
    """

    def off(sigma: float, size: int | tuple[int, int]) -> Array:
        return 1.0 + share * sigma * np.clip(rng.normal(size=size), -2.0, 2.0)

    n = arm.joints
    return replace(
        arm,
        mass=arm.mass * off(0.02, n),
        com=arm.com * off(0.02, (n, 3)) + share * 0.001 * np.clip(rng.normal(size=(n, 3)), -2, 2),
        inertia=arm.inertia * off(0.03, (n, 1)),
        rotor=arm.rotor * off(0.035, n),
        coulomb=arm.coulomb * off(0.035, n),
        viscous=arm.viscous * off(0.035, n),
        resistance=arm.resistance * off(0.03, n),
        standby=arm.standby * float(off(0.012, 1)[0]),
    )
