"""A fleet over half a year: seasons, shifts, programs, payloads, calibrations, gaps, and joints that wear."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .plant import (
    CONSTANTS,
    COULOMB,
    JOINTS,
    RESISTANCES,
    ROTORS,
    SOUND,
    VISCOUS,
    Links,
    motion,
    payload_torque,
    rigid_torque,
    write_description,
)

Float = NDArray[np.float64]

RATE = 50.0
START = datetime(2026, 1, 5, tzinfo=UTC)
"""A Monday in the cold: the season's temperature rises over all of the half year, as wear does."""
STANDBY = 180.0
PROGRAMS, POSES = 6, 4
HEAT = np.array([9.0, 11.0, 9.0, 7.0, 7.0, 6.0])
"""°C that joints are above their hall when they have run for long."""
UNDERSTATED = 0.75
"""Joint 3 of the kind ``press`` has a third more friction than its description says, in every arm."""
TOOL = 1.6
"""kg of the gripper that the description of the kind ``press`` leaves out."""


@dataclass(frozen=True)
class Arm:
    """One arm and its place, for all weeks."""

    name: str
    kind: str
    seed: int
    wear: dict[int, float] = field(default_factory=dict)
    """Joint (from 1) → friction that is added until the end, as a share of what it was."""
    replaced: dict[int, tuple[int, float]] = field(default_factory=dict)
    """Joint → week in which its gear is replaced, and the share of friction that is gone then."""
    payload_from: int | None = None
    """Week from which 1.5 kg more are carried."""
    gaps: frozenset[int] = frozenset()
    """Weeks without any recording."""


def fleet(seed: int, wear: tuple[float, ...] = (0.25, 0.32, 0.40), arms: int = 50, weeks: int = 26) -> list[Arm]:
    """Arms of two kinds, three fifths ``weld``; the first ones of a drawn order wear, the next has a new gear."""
    rng = np.random.default_rng([seed, 1])
    order = [int(i) for i in rng.permutation(arms)]
    out = []
    for i in range(arms):
        kind = "weld" if i < round(0.6 * arms) else "press"
        gaps = set[int]()
        if rng.random() < 0.2:
            first = int(rng.integers(2, weeks - 4))
            gaps |= set(range(first, first + int(rng.integers(1, 5))))
        gaps |= {w for w in range(weeks) if rng.random() < 0.03}
        carried = int(rng.integers(6, weeks - 6)) if rng.random() < 0.12 and weeks > 14 else None
        out.append(Arm(f"{kind}-{i + 1:02d}", kind, seed * 1000 + i, payload_from=carried, gaps=frozenset(gaps)))
    for i, rise in zip(order, wear, strict=False):
        out[i] = _changed(out[i], wear={int(rng.integers(1, JOINTS + 1)): rise})
    if arms > len(wear):
        at = order[len(wear)]
        out[at] = _changed(out[at], replaced={int(rng.integers(1, 4)): (int(0.55 * weeks), 0.28)})
    return out


def _changed(arm: Arm, **changes: object) -> Arm:
    return Arm(**{**arm.__dict__, "payload_from": None, **changes})


@lru_cache(maxsize=64)
def _program(kind: str, number: int, speed: float) -> tuple[Float, Float, Float, Float, Float]:
    """Motion of a program and the torque of one kg carried and of the sound links."""
    rng = np.random.default_rng([7, number, len(kind)])
    poses = np.array([0.0, -0.9, 0.9, 0.0, 0.3, 0.0]) + rng.uniform(-0.75, 0.75, (POSES, JOINTS))
    q, qd, qdd = motion(poses, speed, RATE, 2)
    return q, qd, qdd, payload_torque(1.0, q, qd, qdd), rigid_torque(SOUND, q, qd, qdd)


class Life:
    """The weeks of one arm."""

    def __init__(self, arm: Arm, weeks: int) -> None:
        self.arm, self.weeks = arm, weeks
        rng = self.rng = np.random.default_rng([arm.seed, 2])
        self.gain = 1 + 0.04 * rng.standard_normal(JOINTS)
        self.offset = 0.03 * COULOMB * rng.standard_normal(JOINTS)
        spread = 1 + 0.02 * rng.standard_normal(JOINTS)
        self.links = Links(
            SOUND.masses * spread,
            SOUND.centres * (1 + 0.02 * rng.standard_normal((JOINTS, 1))),
            SOUND.inertias * spread[:, None],
        )
        self.coulomb = COULOMB * np.exp(0.10 * rng.standard_normal(JOINTS))
        self.viscous = VISCOUS * np.exp(0.12 * rng.standard_normal(JOINTS))
        self.thinner = 0.018 * np.exp(0.15 * rng.standard_normal(JOINTS))
        """Share of viscous friction that goes with each °C."""
        self.hall = (19 + 2 * rng.standard_normal(), 5 + 1.0 * rng.standard_normal())
        self.programs = rng.permutation(PROGRAMS)[:3]
        self.speed = float(rng.choice([0.7, 0.85, 1.0]))
        self.payloads = rng.uniform(0, 3, PROGRAMS)
        self.lean = rng.uniform(-1, 1, 3)
        self.wander = self._wander(rng)
        self.phase = rng.uniform(0, 2 * np.pi, JOINTS)

    def _wander(self, rng: np.random.Generator) -> Float:
        """Log friction (weeks, 6) that comes and goes over weeks with no wear."""
        out, last = np.empty((self.weeks, JOINTS)), 0.015 * rng.standard_normal(JOINTS)
        for week in range(self.weeks):
            last = 0.5 * last + 0.015 * np.sqrt(0.75) * rng.standard_normal(JOINTS)
            out[week] = last
        return out

    def level(self, week: float) -> Float:
        """Friction (6,) as a share of the first week's, by wear and new gears alone."""
        out = np.ones(JOINTS)
        for joint, rise in self.arm.wear.items():
            out[joint - 1] += rise * week / (self.weeks - 1)
        for joint, (when, gone) in self.arm.replaced.items():
            out[joint - 1] *= 1 - gone if week >= when else 1 + 0.1 * week / when
        return out

    def recording(self, week: int, number: int) -> tuple[datetime, dict[str, Float]]:
        """One short recording: its begin and its columns."""
        rng = np.random.default_rng([self.arm.seed, 3, week, number])
        day, hour = int(rng.integers(0, 5)), float(rng.uniform(6, 22))
        when = START + timedelta(days=7 * week + day, hours=hour)
        age = 7 * week + day
        mix = np.exp(self.lean * (week / self.weeks - 0.5) * 2)
        program = int(rng.choice(self.programs, p=mix / mix.sum()))
        q, qd, qdd, of_kilogram, _ = _program(self.arm.kind, program, self.speed)
        mean, swing = self.hall
        air = mean - swing * np.cos(2 * np.pi * (age - 10) / 365) + 1.5 * np.sin((hour - 9) / 24 * 2 * np.pi)
        air += 1.2 * rng.standard_normal()
        heat = air + HEAT * (1 - np.exp(-rng.exponential(3.0)))
        carried = self.payloads[program] + (TOOL if self.arm.kind == "press" else 0.0)
        carried += 1.5 * (self.arm.payload_from is not None and week >= self.arm.payload_from)
        rigid = self._rigid(program) + carried * of_kilogram + ROTORS * qdd
        torque = rigid + self._friction(week + day / 7, week, q, qd, rigid, heat, rng)
        return when, self._measured(q, qd, torque, heat, rng)

    @lru_cache(maxsize=8)  # noqa: B019 - lives as long as the arm
    def _rigid(self, program: int) -> Float:
        q, qd, qdd, _, _ = _program(self.arm.kind, program, self.speed)
        return rigid_torque(self.links, q, qd, qdd)

    def _friction(
        self, age: float, week: int, q: Float, qd: Float, rigid: Float, heat: Float, rng: np.random.Generator
    ) -> Float:
        warmth = heat - 28
        size = np.where((self.arm.kind == "press") & (np.arange(JOINTS) == 2), 1 / UNDERSTATED, 1.0)
        size = size * self.level(age) * np.exp(self.wander[week] + 0.012 * rng.standard_normal(JOINTS))
        dry = self.coulomb * (1 - 0.003 * warmth) * (1 + 0.08 * np.exp(-np.abs(qd) / 0.1))
        wet = self.viscous * np.exp(-self.thinner * warmth) * np.abs(qd) ** 0.95
        sign = np.tanh(qd / 0.005)
        ripple = 0.03 * COULOMB * np.sin(9 * q + self.phase)
        return np.asarray(size * sign * (dry + wet + 0.008 * np.abs(rigid)) + ripple)

    def _measured(self, q: Float, qd: Float, torque: Float, heat: Float, rng: np.random.Generator) -> dict[str, Float]:
        current = torque / CONSTANTS
        power = STANDBY + np.sum(torque * qd + RESISTANCES * current**2, axis=1) / 0.94
        told = self.gain * torque + self.offset + 0.02 * COULOMB * rng.standard_normal(q.shape)
        seen = np.round((q + 2e-5 * rng.standard_normal(q.shape)) / 2e-5) * 2e-5
        columns: dict[str, Float] = {}
        for i in range(JOINTS):
            columns |= {f"q_{i + 1}": seen[:, i], f"tau_{i + 1}": told[:, i]}
        if self.arm.kind == "weld":
            warm = heat + 0.4 * rng.standard_normal(JOINTS)
            columns |= {f"temperature_{i + 1}": np.full(len(q), np.round(warm[i], 1)) for i in range(JOINTS)}
        return {**columns, "power": power * (1 + 0.002 * rng.standard_normal()) + 3 * rng.standard_normal(len(q))}


def recordings_in(arm: Arm, week: int) -> int:
    """Recordings of a week: two, in a dull one one, in a gap none."""
    if week in arm.gaps:
        return 0
    return 1 if np.random.default_rng([arm.seed, 4, week]).random() < 0.05 else 2


def write_kinds(lake: Path) -> None:
    """Folders of the two kinds with their descriptions."""
    for kind in ("weld", "press"):
        coulomb, viscous = COULOMB.copy(), VISCOUS.copy()
        write_description(lake / kind, f"{kind}er", coulomb, viscous, STANDBY)


def write_arm(lake: Path, arm: Arm, weeks: int) -> None:
    """All recordings of an arm: ``LAKE/KIND/CELL/2026-01-05T08-30-00.parquet``."""
    folder = lake / arm.kind / arm.name
    folder.mkdir(parents=True, exist_ok=True)
    life = Life(arm, weeks)
    for week in range(weeks):
        for number in range(recordings_in(arm, week)):
            when, columns = life.recording(week, number)
            time = np.arange(len(columns["power"])) / RATE
            place = folder / f"{when:%Y-%m-%dT%H-%M-%S}_{number}.parquet"
            pq.write_table(pa.table({"t": time, **columns}), place, compression="zstd")
