"""Load of the drives during a motion, and its derivative with respect to every parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Mechanics, Motion, Parameters, friction, supply_power, torque
from cellwatt_plugins.robot.drive import drive_power
from cellwatt_plugins.robot.effects import FRICTION
from cellwatt_plugins.robot.effects.friction import Sliding
from cellwatt_plugins.robot.motion import direction


@dataclass(frozen=True)
class Load:
    """``torque`` (N, n) Nm of a motion, ``lever`` (N, n) W/Nm (change of power per torque), supply ``gain`` (N,),
    ``regressor``, powers of the ``drives`` (N, n) W and supply ``power`` (N,) W."""

    motion: Motion
    regressor: Float
    torque: Float
    gain: Float
    lever: Float
    drives: Float
    power: Float

    def slope(self, parameters: Parameters) -> Float:
        """Derivative (N, k) of supply power with respect to the packed parameters."""
        qd, total = self.motion.qd, self.drives.sum(axis=1)
        alive = self.lever != 0.0
        columns = [
            np.einsum("ij,ijk->ik", self.lever, self.regressor),
            self.lever * self.motion.qdd,
            self.lever * direction(qd),
            self.lever * qd,
            self.gain[:, None] * self.torque**2 * alive,
            np.column_stack([np.ones(len(total)), np.maximum(total, 0.0), np.minimum(total, 0.0)]),
        ]
        return np.concatenate(columns, axis=1)


def load_of(body: Mechanics, parameters: Parameters, motion: Motion, dead: Sequence[int] = ()) -> Load:
    """Compute the load of a motion; joints in ``dead`` take no power."""
    regressor = body.regressor(motion.q, motion.qd, motion.qdd)
    forces = torque(parameters, regressor, motion)
    alive = np.array([j not in dead for j in range(motion.q.shape[1])])
    drives = drive_power(parameters.copper, forces, motion.qd) * alive
    gain = np.where(drives.sum(axis=1) > 0, parameters.drive, parameters.regenerate)
    lever = gain[:, None] * (motion.qd + 2 * parameters.copper * forces) * alive
    return Load(motion, regressor, forces, gain, lever, drives, supply_power(parameters, drives))


def motor_alone(parameters: Parameters, motion: Motion, joint: int) -> tuple[Float, Float]:
    """Power (N,) W of friction and of the rotor's acceleration of a motor that turns without its link.

    These are upper limits: no description states the share of a joint's friction and inertia on the motor's side of
    the belt.
    """
    qd = motion.qd[:, joint]
    return qd * friction(parameters, motion.qd)[:, joint], qd * motion.qdd[:, joint] * parameters.rotor[joint]


def unsure_friction(load: Load, joint: int, rubbing: Float) -> Float:
    """Uncertainty (N, k) Nm of friction ``rubbing`` (N,) Nm: one sigma of each friction law of a healthy joint."""
    strain = np.abs(load.torque[:, joint])
    sliding = Sliding(load.motion.qd[:, joint], rubbing, strain / max(float(strain.max()), 1e-9))
    known = [(law, *law.doubt) for law in FRICTION if law.doubt]
    return np.column_stack([share * law.torque(sliding, shape) for law, share, shape in known])
