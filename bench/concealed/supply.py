"""The electrical side of the plant: what the cell's meter sees of joint torques and speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from concealed.arms import Arm, Array

COPPER = 0.00393
"""1/K: temperature coefficient of copper's resistance."""


@dataclass(frozen=True)
class Brake:
    """W while the brakes are released: from the first motion until `delay` s after the last."""

    power: float
    delay: float


@dataclass(frozen=True)
class Iron:
    """Per joint hysteresis loss W s/rad and eddy loss W s²/rad², both of speed alone."""

    hysteresis: Array
    eddy: Array


@dataclass(frozen=True)
class Winding:
    """Windings that warm by `rise` K/W of their own copper loss with one time constant, s."""

    rise: Array
    time_constant: float


@dataclass(frozen=True)
class Fan:
    """A fan of `power` W on a cabinet that warms by `rise` K/W of the supply power, less while the fan runs."""

    power: float
    start_temperature: float
    on_above: float
    off_below: float
    time_constant: float
    rise: float
    cooling: float
    ambient: float


@dataclass(frozen=True)
class Pulses:
    """A load of `power` W for `width` s once every `period` s, whatever the arm does."""

    power: float
    period: float
    width: float


@dataclass(frozen=True)
class Supply:
    """The chain from joints to meter; a part that is None is not there."""

    standby: float
    resistance: Array
    constant: Array
    efficiency: float = 1.0
    dissipates: bool = False
    brake: Brake | None = None
    iron: Iron | None = None
    winding: Winding | None = None
    fan: Fan | None = None
    pulses: Pulses | None = None

    @classmethod
    def of(cls, arm: Arm) -> Supply:
        """The supply that the simulation's law describes."""
        return cls(arm.standby, arm.resistance, arm.constant)

    def power(self, t: Array, torque: Array, v: Array) -> Array:
        """(N,) supply power in W of torque and speed (N, n) on a regular grid t."""
        dt = float(t[1] - t[0])
        drive = np.sum(torque * v + self.copper(torque, dt), axis=1)
        if self.iron:
            drive += np.sum(self.iron.hysteresis * np.abs(v) + self.iron.eddy * v**2, axis=1)
        drive = np.where(drive >= 0, drive / self.efficiency, 0.0 if self.dissipates else drive * self.efficiency)
        total = self.standby + drive
        if self.brake:
            total += self.brake.power * released(v, self.brake.delay, dt)
        if self.pulses:
            total += self.pulses.power * (t % self.pulses.period < self.pulses.width)
        return total if self.fan is None else total + self.fan.power * running(self.fan, total, dt)

    def copper(self, torque: Array, dt: float) -> Array:
        """(N, n) loss in the windings, W."""
        loss = self.resistance * (torque / self.constant) ** 2
        if self.winding is None:
            return loss
        keep = np.exp(-dt / self.winding.time_constant)
        from scipy.signal import lfilter

        return np.asarray(loss * (1 + COPPER * lfilter([1 - keep], [1, -keep], loss * self.winding.rise, axis=0)))


def released(v: Array, delay: float, dt: float) -> Array:
    """(N,) whether the brakes are open: any joint moves, or moved less than `delay` s ago."""
    moving = np.any(np.abs(v) > 0.01, axis=1)
    last = np.maximum.accumulate(np.where(moving, np.arange(len(v)), -(10**9)))
    return np.asarray(np.arange(len(v)) - last <= delay / dt)


def running(fan: Fan, power: Array, dt: float, every: float = 0.05) -> Array:
    """(N,) whether the fan runs, by a two-point switch on the cabinet's temperature."""
    skip = max(1, round(every / dt))
    temperature, on = fan.start_temperature, False
    states = np.empty(-(-len(power) // skip), dtype=bool)
    for i, load in enumerate(power[::skip]):
        on = temperature > (fan.off_below if on else fan.on_above)
        level = fan.ambient + fan.rise * load * (fan.cooling if on else 1.0)
        temperature += skip * dt / fan.time_constant * (level - temperature)
        states[i] = on
    return np.repeat(states, skip)[: len(power)]
