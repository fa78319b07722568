"""A six-joint arm of the IRB 1200's size that runs the two tasks of Sabry et al.: the truth of these tests.

Which joints move in which interval is read from fault tables I and II as printed; ways, masses and losses are our
own. Power is standby, the drives' own, torque times speed (a part of it is lost on the way back), and copper loss.
No code is shared with the plugin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.plugins.faults.plant import Fault as Fault

HOME = np.array([0.0, -0.5, 0.6, 0.2, 0.7, 0.0])  # rad
GRAVITY = np.array([0.0, 38.0, 17.0, 0.6, 2.2, 0.0])  # Nm
INERTIA = np.array([3.2, 3.6, 1.5, 0.35, 0.3, 0.12])  # kg m²
FRICTION = np.array([11.0, 12.0, 9.0, 7.0, 7.5, 5.0])  # Nm
VISCOUS = np.array([7.0, 8.0, 6.0, 4.0, 4.0, 2.5])  # Nm s/rad
LOSS = np.array([0.012, 0.012, 0.02, 0.06, 0.06, 0.08])  # W/(Nm)²
STANDBY = 92.0  # W
RAMP = 0.25
"""Share of a move's time to speed up, and to slow down …"""
JERK = 0.15
"""… and share of it over which the controller rounds the corners of the speed."""
BACK = 0.55  # share of braking power that comes back


@dataclass(frozen=True)
class Move:
    """Joints (1-based) with their way in rad, seconds, seconds at rest afterwards, the table's interval (from 1), and
    joints that go their way and come back within the move."""

    by: Mapping[int, float]
    seconds: float
    interval: int
    rest: float = 0.3
    back: tuple[int, ...] = ()


PICK_AND_PLACE = (
    Move({6: 0.9}, 0.6, 1),
    Move({3: 0.45, 4: -0.5, 5: 0.6, 6: -0.5}, 0.8, 2),
    Move({1: 0.9, 2: 0.45}, 0.9, 3),
    Move({3: -0.45, 4: 0.8, 5: -0.75, 6: 0.6}, 0.8, 4),
    Move({1: -0.9, 2: -0.45, 5: 0.5, 6: -0.6}, 1.0, 5),
    Move({4: -0.3, 5: -0.35, 6: -0.4}, 0.7, 6, 0.9),
)
"""Joints move where Table I has codes; the elbow (joint 3) in the second and the fourth interval."""

POLISHING = (
    Move({1: 0.4, 2: 0.3, 5: -0.6, 6: 0.5}, 0.9, 2, back=(5,)),
    Move({1: -0.3, 2: 0.25, 6: -0.7}, 0.7, 3),
    Move({1: 0.35, 2: -0.3, 3: 0.35, 4: -0.6}, 0.8, 4),
    Move({1: -0.3, 2: 0.3, 6: 0.7}, 0.7, 5),
    Move({1: 0.3, 2: -0.3, 3: -0.6, 4: 0.7}, 0.8, 6),
    Move({1: -0.3, 2: 0.2, 6: -0.6}, 0.7, 7),
    Move({3: 0.25, 4: -0.1}, 0.6, 8),
    Move({1: -0.15, 2: -0.45, 6: 0.1}, 0.8, 9, 0.9),
)
"""Joints move where Table II has codes; it has none for joint 5 but in the second interval, which therefore brings it
back. In the first and the tenth interval nothing moves."""

BOUNDARIES = (0.74, 1.52, 2.17, 2.6, 3.73)
"""s; where the paper sees the peaks of Fig. 9, "at the deceleration and acceleration stages" …"""
LENGTH = 5.4
"""… of a cycle of so many s (end of the last stretch in which the spring shows, Fig. 13 and 14)."""
PICK_AND_PLACE_AS_TIMED = tuple(
    replace(move, seconds=end - start, rest=0.0)
    for move, start, end in zip(PICK_AND_PLACE, (0.0, *BOUNDARIES), (*BOUNDARIES, LENGTH), strict=True)
)
"""Table I with the paper's times: no row is without a code, so no rest lies between two moves."""
POLISHING_WITHOUT_RESTS = tuple(replace(move, rest=0.0) for move in POLISHING)
"""Table II has no row without a code but its first and its last."""


@dataclass(frozen=True)
class Run:
    """``cycles`` repetitions of ``moves`` at ``speed`` (1 as planned), with ``faults`` from cycle ``since`` on.

    Their kinds are spring (Nm/rad from the home pose), cut or belt_off (the joint stands still, its drive draws
    nothing), encoder_creep (it shows the share ``size`` of the way), encoder_offset (rad) and friction (Nm).
    """

    moves: Sequence[Move] = PICK_AND_PLACE
    cycles: int = 1
    speed: float = 1.0
    faults: Sequence[Fault] = ()
    since: int = 0
    rate: float = 123.0
    noise: float = 1.0
    seed: int = 0
    lead: float = 0.0
    """s at rest before the first cycle."""


@dataclass(frozen=True)
class Told:
    """Times (n,) s, encoders (n, 6) rad, power (n,) W, and the start of each cycle, s."""

    t: np.ndarray
    q: np.ndarray
    power: np.ndarray
    starts: np.ndarray = field(default_factory=lambda: np.empty(0))


def period(moves: Sequence[Move], speed: float = 1.0) -> float:
    """Duration of a cycle, s."""
    return sum(m.seconds + m.rest for m in moves) / speed


def commanded(moves: Sequence[Move], phase: np.ndarray) -> np.ndarray:
    """Planned positions (n, 6) rad at phases (n,) s of a cycle at full speed: constant speed between rounded ramps."""
    q, start = np.tile(HOME, (len(phase), 1)), 0.0
    for move in moves:
        share = covered(np.clip((phase - start) / move.seconds, 0.0, 1.0))
        for joint, way in move.by.items():
            q[:, joint - 1] += way * (4 * share * (1 - share) if joint in move.back else share)
        start += move.seconds + move.rest
    return q


def covered(s: np.ndarray) -> np.ndarray:
    """Share of the way at the share ``s`` of the time: a trapezoid of speed, its corners rounded."""
    fine = np.linspace(0, 1, 1001)
    speed = np.clip(np.minimum(fine - JERK / 2, 1 - JERK / 2 - fine) / RAMP, 0, 1)
    box = np.ones(round(JERK * 1000)) / round(JERK * 1000)
    way = np.cumsum(np.convolve(speed, box, mode="same"))
    return np.interp(s, fine, (way - way[0]) / (way[-1] - way[0]))


def run(plan: Run) -> Told:
    """What encoders and the power meter give."""
    random = np.random.default_rng(plan.seed)
    length = period(plan.moves, plan.speed)
    t = np.arange(round((plan.lead + plan.cycles * length) * plan.rate)) / plan.rate
    since = t - plan.lead
    cycle = np.floor_divide(since, length)
    wanted = commanded(plan.moves, np.where(since < 0, 0.0, np.mod(since, length) * plan.speed))
    true, shown, drawn = wanted.copy(), wanted.copy(), np.ones_like(wanted)
    pull, rubbing = np.zeros_like(wanted), np.zeros_like(wanted)
    late = cycle >= plan.since
    for fault in plan.faults:
        j = fault.joint - 1
        if fault.kind in ("cut", "belt_off"):
            true[late, j] = shown[late, j] = HOME[j]
            drawn[late, j] = 0.0
    for fault in plan.faults:
        j = fault.joint - 1
        if fault.kind == "encoder_creep":
            shown[late, j] = HOME[j] + fault.size * (wanted[late, j] - HOME[j])
        elif fault.kind == "encoder_offset":
            shown[late, j] += fault.size
        elif fault.kind == "spring":
            pull[late, j] = fault.size * (true[late, j] - HOME[j])
        elif fault.kind == "friction":
            rubbing[late, j] = fault.size
    power = _power(true, drawn, pull, FRICTION + rubbing, plan.rate)
    q = shown + plan.noise * 3e-5 * random.standard_normal(shown.shape)
    starts = plan.lead + length * np.arange(plan.cycles)
    return Told(t, q, power + plan.noise * 1.0 * random.standard_normal(len(t)), starts)


def _power(q: np.ndarray, drawn: np.ndarray, pull: np.ndarray, friction: np.ndarray, rate: float) -> np.ndarray:
    w = np.gradient(q, 1 / rate, axis=0)
    a = np.gradient(w, 1 / rate, axis=0)
    torque = GRAVITY * np.cos(q) + INERTIA * a + friction * np.tanh(w / 0.02) + VISCOUS * w + pull
    mechanical = torque * w
    mechanical = np.where(mechanical < 0, BACK * mechanical, mechanical)
    power = STANDBY + (drawn * (mechanical + LOSS * torque**2)).sum(axis=1)
    smooth = np.exp(-np.arange(0, 0.06, 1 / rate) / 0.012)  # the supply's capacitors
    padded = np.concatenate([np.full(len(smooth) - 1, power[0]), power])
    return np.convolve(padded, smooth / smooth.sum(), mode="valid")
