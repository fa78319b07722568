"""Advice that saves energy, computed from a task's motion: another speed, or brakes while the arm waits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.energy.drive import bus_power, features, supply_power
from cellwatt_plugins.energy.known import Known
from cellwatt_plugins.energy.task_energy import Stretch, resting_power
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import rates

SCALES = np.round(np.geomspace(0.5, 3.0, 37), 3)
"""Durations of the motion that are tried, relative to its present duration."""
CHANGE = 0.1
"""Model error as a share of a change of energy, one standard deviation."""
WORTH = 0.01
"""Smallest saving that is reported, as a share of the cycle's energy …"""
SURE = 2.0
"""… and in multiples of its uncertainty."""


@dataclass(frozen=True)
class Advice:
    """A change (``kind``: slower, faster or brakes) and its ``saving``, J per cycle, with one standard deviation.

    ``setting`` holds the values to set, with units in their names.
    """

    kind: str
    statement: str
    saving: float
    uncertainty: float
    setting: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Cycle:
    """A recurring task: its motion, the time for which the arm then waits, s, and the frames of this rest.

    Without these frames, the arm is assumed to wait in the state at the motion's end.
    """

    motion: Stretch
    waiting: float
    rest: Stretch | None = None

    @property
    def holding(self) -> Float:
        """Torque (n,) Nm, as reported by the robot, while the arm waits."""
        return self.motion.torque[-1] if self.rest is None else np.median(self.rest.torque, axis=0)

    def braked(self, known: Known) -> bool:
        """True if the arm already waits with its brakes on."""
        return self.rest is not None and float(np.median(self.rest.power)) < known.drive.fixed - known.brakes / 2

    def resting(self, arm: Arm, known: Known) -> float:
        """Power, W, while the arm waits."""
        held = known.drive.fixed + resting_power(arm, known, self.holding)
        return known.drive.fixed - known.brakes if self.braked(known) else held


def advise(arm: Arm, known: Known, cycle: Cycle, brake_time: float) -> list[Advice]:
    """Return the advice, largest saving first; applying and releasing the brakes takes ``brake_time`` s."""
    found = [speed_advice(arm, known, cycle)]
    if not cycle.braked(known):
        found.append(brake_advice(arm, known, cycle, brake_time))
    whole = float(cycle.motion.power.sum()) * cycle.motion.step + cycle.waiting * cycle.resting(arm, known)
    worthwhile = [a for a in found if a is not None and a.saving > max(WORTH * whole, SURE * a.uncertainty)]
    return sorted(worthwhile, key=lambda advice: -advice.saving)


def motion_energy(arm: Arm, known: Known, motion: Stretch, scale: float) -> float:
    """Energy, J, of the motion along the same path in ``scale`` times the duration.

    Velocities scale with 1/scale, accelerations with 1/scale². The inertial torque of the rigid bodies and viscous
    friction change; the rest of the measured torque (gravity, payload's weight, Coulomb friction) is unchanged.
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
    """The speed at which motion and waiting together need least energy, in the same cycle time.

    Without waiting, the next cycle follows at once, and the energy per cycle is minimised whatever its duration.
    """
    motion = cycle.motion
    seconds = motion.step * len(motion.power)
    rest = cycle.resting(arm, known)
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
    where = "in the same cycle time" if cycle.waiting > 0 else "if the next cycle follows at once"
    return Advice(
        kind,
        f"moving {kind}, in {best * seconds:.1f} s instead of {seconds:.1f} s, saves {saving:.0f} J per cycle {where}",
        saving,
        CHANGE * abs(saving) + known.model_error * now,
        {"motion_s": best * seconds},
    )


def brake_advice(arm: Arm, known: Known, cycle: Cycle, brake_time: float) -> Advice | None:
    """Waiting with the brakes on, when neither the brakes nor the motors draw power."""
    braked = cycle.waiting - brake_time
    if not known.brakes or braked <= 0:
        return None
    hold = resting_power(arm, known, cycle.holding)
    saving = (known.brakes + hold) * braked
    return Advice(
        "brakes",
        f"putting the brakes on {brake_time:g} s after the task saves {known.brakes + hold:.1f} W, "
        f"{saving:.0f} J per cycle with {cycle.waiting:.0f} s of waiting",
        saving,
        float(np.hypot(known.brakes_uncertainty, CHANGE * hold)) * braked,
        {"after_s": brake_time},
    )
