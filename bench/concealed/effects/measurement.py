"""What is wrong with the measured torque, not with the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from concealed import sensing
from concealed.effects.kinds import Kind, Truth, by_level, either, every, into
from concealed.setting import RATIO, Setting, require

MEASUREMENT: dict[str, Kind] = {}


def add_sensor(s: Setting, sensor: sensing.Sensor) -> None:
    """Put a sensor into the measuring chain, before the noise."""
    s.interface = replace(s.interface, sensors=(*s.interface.sensors, sensor))


def add_output(s: Setting, output: sensing.Sensor) -> None:
    """Put a sensor into the measuring chain, after the noise."""
    s.interface = replace(s.interface, outputs=(*s.interface.outputs, output))


@into(MEASUREMENT, every)
def torque_gain(s: Setting, joint: int) -> Truth:
    """Measured torque off by a factor."""
    gain = either(s) * by_level(s, 0.07, 0.1, 0.15, 0.25)
    require(abs(gain) * s.rms(s.torque[:, :, joint]) / s.base.noise[joint] > RATIO["weak"][0])
    add_sensor(s, sensing.Gain(joint, gain))
    return {"gain": gain}


@into(MEASUREMENT, every)
def torque_offset(s: Setting, joint: int) -> Truth:
    """Measured torque off by a constant."""
    offset = either(s) * s.target() * float(s.base.noise[joint])
    add_sensor(s, sensing.Offset(joint, offset))
    return {"offset": offset}


@into(MEASUREMENT, every, "medium")
def torque_drift(s: Setting, joint: int) -> Truth:
    """A measured offset that grows through each recording."""
    seconds = s.plans[0].seconds
    rate = either(s) * s.target() * float(s.base.noise[joint]) * np.sqrt(3.0) / seconds
    add_sensor(s, sensing.Drift(joint, rate))
    return {"rate": rate}


def lateness(s: Setting) -> float:
    """Seconds of delay of the torque that give the level's ratio at the joint where it shows most."""
    change = np.gradient(s.torque, s.grid, axis=0)
    slopes = [s.rms(np.clip(change[:, :, j], -1e3, 1e3)) / s.base.noise[j] for j in range(s.joints)]
    return float(np.clip(s.target() / max(slopes), 0.006, 0.045))


@into(MEASUREMENT, None)
def time_delay(s: Setting, joint: int) -> Truth:
    """Measured torque later than position and velocity."""
    delay = lateness(s)
    s.interface = replace(s.interface, delay=delay, skew=0.0)
    return {"delay": delay}


@into(MEASUREMENT, None, "long")
def clock_drift(s: Setting, joint: int) -> Truth:
    """Torque stamped by a clock that runs away from that of position and velocity."""
    rate = 1.6 * lateness(s) / s.plans[0].seconds
    s.interface = replace(s.interface, clock_rate=rate)
    return {"rate": rate}


@into(MEASUREMENT, every)
def torque_saturation(s: Setting, joint: int) -> Truth:
    """Measured torque clipped at a limit below what the task needs."""
    torque = s.torque[:, :, joint]
    top = float(np.max(np.abs(torque[:, : s.opens])))
    limits = np.linspace(0.45, 0.95, 26) * top
    ratios = np.array([s.rms(torque - np.clip(torque, -x, x)) for x in limits]) / s.base.noise[joint]
    require(ratios.max() > RATIO["weak"][0])
    limit = float(limits[np.argmin(np.abs(ratios - s.target()))])
    require(s.rms(torque - np.clip(torque, -limit, limit)) > RATIO["weak"][0] * s.base.noise[joint])
    add_output(s, sensing.Clipping(joint, limit))
    return {"limit": limit}
