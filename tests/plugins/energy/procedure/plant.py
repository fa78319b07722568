"""Four arms on their cubes: what they draw follows Tables II and III of ECDP, and is known to the joule.

Kinematics and masses are near the makers'; losses are then chosen so that the energy of each run is the table's.
Simulated at 500 Hz by ``bench/energy``'s Newton-Euler, which shares no code with the product.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from energy.arms import rod
from energy.chain import Link, rotations, torques, write_robot
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from tests.plugins.energy.procedure.cube import CUBES, TABLE_SECONDS
from tests.science.test_energy_split import TABLE_III

STEP = 0.002
DWELL, BETWEEN = 1.0, 3.0
TURNED = 0.5
"""Share of the braking power on the bus that the electronics take."""


@dataclass(frozen=True)
class Made:
    """A robot of the tables."""

    name: str
    arm: tuple[float, float, float]
    """Height of the shoulder, upper arm, forearm, m."""
    masses: tuple[float, ...]
    controller: float
    electronics: float
    brakes: float
    by_current: bool = False
    gains: tuple[float, ...] = ()
    """Torque as given against true torque."""
    separate: bool = True

    @property
    def joints(self):
        return len(self.masses)

    @property
    def total(self):
        """E_R of Table III by speed, without and with payload, J."""
        return {50 * (i + 1): (row[0], row[5]) for i, row in enumerate(TABLE_III[self.name])}

    @property
    def fixed(self):
        return self.controller + self.electronics + self.brakes


UR5E = Made(
    "UR5e",
    (0.1625, 0.425, 0.392),
    (3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    54.03,
    27.38,
    4.3669,
    by_current=True,
    gains=(0.93, 0.9, 0.88, 0.95, 1.04, 0.9),
)
UR10E = Made(
    "UR10e",
    (0.181, 0.613, 0.572),
    (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
    52.29,
    26.27,
    6.9176,
    by_current=True,
    gains=(1.05, 0.92, 0.9, 0.94, 0.9, 1.0),
)
FR3 = Made(
    "FR3",
    (0.333, 0.316, 0.384),
    (4.97, 3.6, 2.3, 3.59, 1.23, 1.67, 0.74),
    32.12,
    33.09,
    18.6436,
)
GEN3 = Made(
    "Gen3",
    (0.284, 0.46, 0.43),
    (1.38, 1.16, 1.16, 0.93, 0.68, 0.68, 0.36),
    29.54,
    0.0,
    0.0,
    separate=False,
)
ROBOTS = {made.name: made for made in (UR5E, UR10E, FR3, GEN3)}


def links_of(made):
    """Shoulder, elbow and wrist about z, y, y, y, z, x; with seven joints the upper arm turns too, about x."""
    height, a, b = made.arm
    m = made.masses
    six = [
        Link((0, 0, height), (0, 0, 1), m[0], (0, 0, -0.03), rod(m[0], 0.15, 2)),
        Link((0, 0.1, 0), (0, 1, 0), m[1], (0.45 * a, 0, 0), rod(m[1], a, 0)),
        Link((a, -0.09, 0), (0, 1, 0), m[-4], (0.5 * b, 0, 0), rod(m[-4], b, 0)),
        Link((b, 0.08, 0), (0, 1, 0), m[-3], (0, 0.02, 0.01), rod(m[-3], 0.1, 1)),
        Link((0.04, 0.04, 0), (0, 0, 1), m[-2], (0.01, 0, 0.02), rod(m[-2], 0.1, 2)),
        Link((0.04, 0, 0), (1, 0, 0), m[-1], (0.03, 0, 0), rod(m[-1], 0.08, 0)),
    ]
    if made.joints == 7:
        six.insert(2, Link((0.9 * a, 0, 0), (1, 0, 0), m[2], (0.02, 0, 0.01), rod(m[2], 0.12, 0)))
        six[3] = replace(six[3], origin=(0.1 * a, -0.09, 0))
    return tuple(six)


def places(links, q):
    """Place (N, 3) and orientation (N, 3, 3) of the last frame."""
    at, turn = np.zeros((len(q), 3)), np.tile(np.eye(3), (len(q), 1, 1))
    for i, link in enumerate(links):
        at = at + turn @ np.array(link.origin)
        turn = turn @ rotations(link.axis, q[:, i])
    return at, turn


def solve(links, target, q):
    """Joints (n,) rad whose last frame is at ``target`` (3,) m and turned as the base; damped Newton from ``q``."""
    for _ in range(200):
        steps = np.vstack([q, q + 1e-6 * np.eye(len(q))])
        at, turn = places(links, steps)
        error = np.column_stack([target - at, _twist(turn)])
        if np.abs(error[0]).max() < 1e-10:
            return q
        jacobian = (error[1:] - error[0]).T / -1e-6
        jacobian[:, 2] *= len(q) == 6  # a seventh joint stays where it is, so that the way is closed
        q = q + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-8 * np.eye(6), np.clip(error[0], -0.1, 0.1))
    raise AssertionError(f"{target}: out of reach")


def _twist(turn):
    """What turns ``turn`` (N, 3, 3) back to the base's axes, as small rotations (N, 3)."""
    skew = (turn.transpose(0, 2, 1) - turn) / 2
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


class Arm:
    """A robot on its cube, with losses that bring its runs to the table's energies."""

    def __init__(self, made):
        self.made, self.links = made, links_of(made)
        self.cube = CUBES[made.name]
        n = made.joints
        size = np.array([1.0, 1.0, *([0.6] * (n - 5)), 0.25, 0.2, 0.15])[:n] * (2.0 if made.name == "UR10e" else 1.0)
        self.constant = 10.0 * np.sqrt(size)
        self.rotor = 0.8 * size
        self.described = 0.8 / size
        self.way = self._way()
        travelled = np.abs(self.motion(250.0)[1]).sum() * STEP
        self.friction = np.full(n, 6.0 / travelled)
        """Coulomb friction (n,) Nm that takes 6 J in a repetition: Table III's mechanical losses."""
        self.rates = self._rates()

    def _way(self):
        """Joint angles along the path, one spline a leg, over the share of the leg."""
        n = self.made.joints
        q, legs = np.zeros(n), []
        q[1], q[-4], q[-3] = -1.0, 1.6, -0.6
        for a, b in pairwise(self.cube.path):
            shares = np.linspace(0, 1, 60)
            rows = []
            for share in shares:
                q = solve(self.links, a + share * (b - a), q)
                rows.append(q)
            legs.append(CubicSpline(shares, np.array(rows)))
        return legs

    def motion(self, speed):
        """One repetition from rest to rest: q, qd, qdd, (N, n) each."""
        parts = []
        for leg, seconds in zip(self.way, self.cube.seconds(speed), strict=True):
            count = max(10, round(seconds / STEP))
            s, v, a = _timing(count)
            length = count * STEP
            q, slope, bend = leg(s), leg(s, 1), leg(s, 2)
            parts.append((q, slope * v[:, None] / length, (bend * v[:, None] ** 2 + slope * a[:, None]) / length**2))
        return tuple(np.vstack(columns) for columns in zip(*parts, strict=True))

    def torque(self, q, qd, qdd, payload):
        """(N, n) Nm, with rotors and friction."""
        rigid = torques(self.links, q, qd, qdd, payload, (0.05, 0.0, 0.02)) + self.rotor * qdd
        return rigid + self.friction * np.tanh(qd / 0.002)

    def losses(self, torque, qd):
        """Copper, switching, iron, hysteresis (N, 4) W at the rates of the first guess."""
        current = torque / self.constant
        of_joints = (self.described * current**2, np.abs(current), qd**2, np.abs(qd))
        return np.stack([each.sum(axis=1) for each in of_joints], axis=1)

    def powers(self, torque, qd):
        """Groups (N,) W."""
        mechanical = (torque * qd).sum(axis=1)
        electrical = self.losses(torque, qd) @ self.rates
        bus = mechanical + electrical
        supply = np.where(bus > 0, bus, TURNED * bus)
        positive = np.maximum(torque * qd, 0).sum(axis=1)
        return {
            "mechanical_losses": mechanical,
            "electrical_losses_with_regeneration": electrical + supply - bus,
            "regeneration": supply - bus,
            "positive_mechanical": positive,
            "supply": supply,
        }

    def _rates(self):
        """What copper, switches and iron lose, by least squares to Table III's energies."""
        rows, wanted = [], []
        for speed, energies in self.made.total.items():
            q, qd, qdd = self.motion(speed)
            for payload, energy in zip((0.0, self.cube.payload), energies, strict=True):
                torque = self.torque(q, qd, qdd, payload)
                seconds, weight = len(q) * STEP, 1 / energy
                rows.append(self.losses(torque, qd).sum(axis=0) * STEP * weight)
                mechanical = (torque * qd).sum() * STEP
                table = energy * seconds / (TABLE_SECONDS[self.made.name] * 50 / speed)
                wanted.append((table - self.made.fixed * seconds - mechanical) * weight)
        return nnls(np.array(rows), np.array(wanted))[0]

    def truth(self, speed, payload):
        """Energies (J) of one repetition."""
        q, qd, qdd = self.motion(speed)
        parts = self.powers(self.torque(q, qd, qdd, payload), qd)
        seconds, made = len(q) * STEP, self.made
        energy = {name: float(power.sum() * STEP) for name, power in parts.items()}
        return {
            **energy,
            "seconds": seconds,
            "total": energy["supply"] + made.fixed * seconds,
            "electronics": (made.controller + made.electronics) * seconds,
            "brakes": made.brakes * seconds,
        }

    def programme(self, payload, speeds, repetitions, rng):
        """A whole program as it is recorded: q, qd, given torque at 500 Hz, and power at 500 Hz."""
        still = self.way[0](0.0)[None, :]
        rest = {"q": still, "qd": 0 * still, "tau": self.torque(still, 0 * still, 0 * still, payload)}
        idle = self.powers(rest["tau"], rest["qd"])["supply"][0]
        blocks, power = [], []

        def wait(seconds):
            count = round(seconds / STEP)
            blocks.append(np.repeat(np.hstack([rest["q"], rest["qd"], rest["tau"]]), count, axis=0))
            power.append(np.full(count, idle))

        for speed in speeds:
            wait(BETWEEN)
            q, qd, qdd = self.motion(speed)
            tau = self.torque(q, qd, qdd, payload)
            drawn = self.powers(tau, qd)["supply"]
            for _ in range(repetitions):
                wait(DWELL)
                blocks.append(np.hstack([q, qd, tau]))
                power.append(drawn)
        wait(BETWEEN)
        rows, watts = np.vstack(blocks), np.concatenate(power) + self.made.fixed
        n = self.made.joints
        given = np.array(self.made.gains or (1.0,) * n)
        noise = np.concatenate([np.full(n, 2e-5), np.full(n, 1e-3), np.full(n, 0.02)])
        rows[:, 2 * n :] *= given
        return rows + rng.normal(size=rows.shape) * noise, watts

    def describe(self, folder: Path):
        """robot.yaml and robot.urdf as the user has them: masses and resistances a little off."""
        drives = {"torque_constant": self.constant, "rotor_inertia": self.rotor, "winding_resistance": self.described}
        head = {"robot": self.made.name, "payload": self.cube.payload}
        head |= {"brakes": self.made.brakes > 0, "controller_separate": self.made.separate}
        head |= {"torque_from": "current" if self.made.by_current else "sensor"}
        return write_robot(folder, self.links, drives, **head)


def _timing(count):
    """Share of a leg, its first and second derivative over the leg's time, at ``count`` points: ramps of a fifth."""
    ramp, top = 0.2, 1.25
    x = (np.arange(count) + 1) / count
    near = np.minimum(x, 1 - x)
    y = np.minimum(near / ramp, 1.0)
    s = top * (ramp * (y**2 / 2 + (np.cos(2 * np.pi * y) - 1) / (4 * np.pi**2)) + near - ramp * y)
    v = top * (y - np.sin(2 * np.pi * y) / (2 * np.pi))
    a = top / ramp * (1 - np.cos(2 * np.pi * y)) * np.sign(0.5 - x)
    return np.where(x < 0.5, s, 1 - s), v, a
