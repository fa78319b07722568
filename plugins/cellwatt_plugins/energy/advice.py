"""Advice that saves energy, from a task's own motion: its speed, brakes while it waits, its waiting pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from cellwatt_plugins.energy.drive import bus_power, features, supply_power
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.energy.task_energy import Stretch, resting_power
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import direction, rates

Float = NDArray[np.float64]

STEP: Final = 0.01
"""s."""
SHORTEST: Final = 0.5
"""s."""
PEAK: Final = 1.875
"""Greatest velocity of a minimum-jerk move, in distance by time."""
SCALES = np.round(np.geomspace(0.5, 3.0, 37), 3)
"""Lengths of the motion that are tried, against its present length."""
CHANGE = 0.1
"""Share of a change of energy by which the model may miss it, one standard deviation."""
WORTH = 0.01
"""Share of the cycle's energy that a saving must have to be told …"""
SURE = 2.0
"""… and how many times its uncertainty."""
WAYS = (0.25, 0.5, 0.75, 1.0)
"""Shares of the way to the pose of least gravity at which waiting is tried."""
STARTS = 12
"""Poses from which the pose of least gravity is looked for."""


@dataclass(frozen=True)
class Advice:
    """One change, and what it saves each cycle."""

    kind: str
    """slower, faster, brakes or pose."""
    statement: str
    saving: float
    """J a cycle."""
    uncertainty: float
    """J, one standard deviation."""
    setting: Mapping[str, float] = field(default_factory=dict)
    """Settings to be made, with units in the names."""


@dataclass(frozen=True)
class Cycle:
    """A task as it recurs: its motion, how long the arm then waits, s, and the frames while it does."""

    motion: Stretch
    waiting: float
    rest: Stretch | None = None
    """Without it the arm is taken to wait as at the motion's end."""

    @property
    def pose(self) -> Float:
        """Pose in which it waits, (n,) rad."""
        return self.motion.position[-1] if self.rest is None else np.median(self.rest.position, axis=0)

    @property
    def holding(self) -> Float:
        """Torque (n,) Nm as given, while it waits."""
        return self.motion.torque[-1] if self.rest is None else np.median(self.rest.torque, axis=0)

    def braked(self, known: Known) -> bool:
        """True if it waits with its brakes on already."""
        return self.rest is not None and float(np.median(self.rest.power)) < known.drive.fixed - known.brakes / 2


def advise(arm: Arm, known: Known, cycle: Cycle, brake_time: float) -> list[Advice]:
    """Return the advice, the largest saving first; ``brake_time`` s is lost with putting brakes on and off."""
    found = [speed_advice(arm, known, cycle)]
    if not cycle.braked(known):
        found += [brake_advice(arm, known, cycle, brake_time), pose_advice(arm, known, cycle)]
    whole = float(cycle.motion.power.sum()) * cycle.motion.step + cycle.waiting * known.drive.fixed
    told = [a for a in found if a is not None and a.saving > max(WORTH * whole, SURE * a.uncertainty)]
    return sorted(told, key=lambda advice: -advice.saving)


def motion_energy(arm: Arm, known: Known, motion: Stretch, scale: float) -> float:
    """Energy J of a motion that takes ``scale`` times as long along the same path.

    Velocities go with 1/scale and accelerations with 1/scale². Torque changes by what rigid bodies and viscous friction
    change; the rest of the measured torque (gravity, payload's weight, Coulomb friction) stays.
    """
    acceleration = rates(motion.velocity, motion.step)[1]
    still = np.zeros_like(motion.velocity)
    inertial = arm.body.inverse_dynamics(motion.position, motion.velocity, acceleration)
    inertial = inertial - arm.body.inverse_dynamics(motion.position, still, still)
    inertial = inertial + arm.column("rotor_inertia") * acceleration
    viscous = np.array(known.viscous) * motion.velocity
    change = inertial * (1 / scale**2 - 1) + viscous * (1 / scale - 1)
    torque = motion.torque + change / known.drive.torque
    bus = bus_power(known.drive, features(arm, torque, motion.velocity / scale))
    return float(supply_power(known.drive, bus).sum()) * motion.step * scale


def speed_advice(arm: Arm, known: Known, cycle: Cycle) -> Advice | None:
    """The speed at which motion and waiting together take least, in the same cycle time.

    Without waiting the next cycle follows at once: then the energy of a cycle counts, however long it takes.
    """
    motion = cycle.motion
    seconds = motion.step * len(motion.power)
    rest = known.drive.fixed + resting_power(arm, known, cycle.holding)
    limits = np.where(arm.velocity_limits > 0, arm.velocity_limits, np.inf)
    fastest = max(float((np.abs(motion.velocity).max(axis=0) / limits).max()), float(SCALES[0]))
    slowest = 1 + cycle.waiting / seconds if cycle.waiting > 0 else float(SCALES[-1])
    allowed = [float(s) for s in SCALES if fastest <= s <= slowest]
    if not allowed:
        return None
    energies = {s: motion_energy(arm, known, motion, s) for s in allowed}
    now = motion_energy(arm, known, motion, 1.0)
    costs = {s: e - (s - 1) * seconds * rest * (cycle.waiting > 0) for s, e in energies.items()}
    best = min(costs, key=lambda s: costs[s])
    saving = now - costs[best]
    kind = "slower" if best > 1 else "faster"
    where = "in the same cycle time" if cycle.waiting > 0 else "where the next cycle follows at once"
    return Advice(
        kind,
        f"moving {kind}, in {best * seconds:.1f} s instead of {seconds:.1f} s, saves {saving:.0f} J a cycle {where}",
        saving,
        CHANGE * abs(saving) + known.model_error * now,
        {"motion_s": best * seconds},
    )


def brake_advice(arm: Arm, known: Known, cycle: Cycle, brake_time: float) -> Advice | None:
    """Waiting with the brakes on: neither they nor the motors draw anything."""
    left = cycle.waiting - brake_time
    if not known.brakes or left <= 0:
        return None
    hold = resting_power(arm, known, cycle.holding)
    saving = (known.brakes + hold) * left
    return Advice(
        "brakes",
        f"putting the brakes on {brake_time:g} s after the task saves {known.brakes + hold:.1f} W, "
        f"{saving:.0f} J a cycle of {cycle.waiting:.0f} s waiting",
        saving,
        float(np.hypot(known.brakes_uncertainty, CHANGE * hold)) * left,
        {"after_s": brake_time},
    )


def pose_advice(arm: Arm, known: Known, cycle: Cycle) -> Advice | None:
    """Waiting nearer to where gravity asks least of the motors (eq. 15), the way there and back counted.

    What the arm holds beyond its own weight is not known elsewhere: it counts as uncertainty.
    """
    end = cycle.pose
    hold = resting_power(arm, known, cycle.holding)
    own = resting_power(arm, known, _holding(arm, known, end))
    least, fastest = least_gravity(arm, end), float(np.abs(cycle.motion.velocity).max())
    found: list[Advice] = []
    for pose in (end + share * (least - end) for share in WAYS):
        seconds = way_seconds(end, pose, fastest)
        if 2 * seconds >= cycle.waiting:
            continue
        there = resting_power(arm, known, _holding(arm, known, pose))
        ways = way_energy(arm, known, end, pose, seconds) + way_energy(arm, known, pose, end, seconds)
        saving = hold * cycle.waiting - ways - there * (cycle.waiting - 2 * seconds)
        unsure = np.hypot(CHANGE * (hold + there), hold - own) * cycle.waiting
        degrees = ", ".join(f"{angle:.0f}" for angle in np.degrees(pose))
        found.append(
            Advice(
                "pose",
                f"waiting at joints {degrees} deg, where that is free of collision, takes {hold - there:.1f} W less: "
                f"saves {saving:.0f} J a cycle of {cycle.waiting:.0f} s waiting, {seconds:.1f} s each way counted",
                saving,
                float(np.hypot(unsure, CHANGE * ways)),
                {"way_s": seconds} | {f"joint_{i + 1}_rad": float(angle) for i, angle in enumerate(pose)},
            )
        )
    return max(found, key=lambda advice: advice.saving, default=None)


def way_seconds(start: Float, end: Float, fastest: float) -> float:
    """Time of a minimum-jerk move between two poses (n,) rad whose fastest joint reaches ``fastest`` rad/s."""
    return max(PEAK * float(np.abs(end - start).max()) / fastest, SHORTEST)


def way_energy(arm: Arm, known: Known, start: Float, end: Float, seconds: float) -> float:
    """Energy J beyond fixed power of a minimum-jerk move between two poses (n,) rad, without payload.

    Torque is that of the rigid bodies, rotors and friction (Flash, Hogan, 1985, for the move).
    """
    s = ((np.arange(max(2, round(seconds / STEP))) + 0.5) * STEP / seconds)[:, None]
    way = end - start
    q = start + way * (10 * s**3 - 15 * s**4 + 6 * s**5)
    qd = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds
    qdd = way * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2
    torque = arm.body.inverse_dynamics(q, qd, qdd) + arm.column("rotor_inertia") * qdd
    torque = torque + np.array(known.viscous) * qd + np.array(known.coulomb) * direction(qd)
    bus = bus_power(known.drive, features(arm, torque / known.drive.torque, qd))
    return float((supply_power(known.drive, bus) - known.drive.fixed).sum()) * STEP


def _holding(arm: Arm, known: Known, pose: Float) -> Float:
    """Torque (n,) Nm as the robot would give it, that holds the arm's own weight at ``pose`` (n,) rad."""
    return np.asarray(arm.gravity(pose[None, :])[0] / known.drive.torque)


def least_gravity(arm: Arm, near: Float) -> Float:
    """θ_GZ (n,) rad: the pose within the joints' limits at which ‖G(θ)‖ is least (eq. 15), from ``near`` and others."""
    lower, upper = np.clip(arm.limits, -np.pi, np.pi).T
    draw = np.random.default_rng(0)
    starts = [np.clip(near, lower, upper), *draw.uniform(lower, upper, (STARTS, arm.joints))]

    def square(q: Float) -> float:
        return float(np.sum(arm.gravity(q[None, :]) ** 2))

    found = [
        minimize(square, start, method="L-BFGS-B", bounds=list(zip(lower, upper, strict=True))) for start in starts
    ]
    return np.asarray(min(found, key=lambda one: float(one.fun)).x)
