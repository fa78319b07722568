"""The robot behind an emulated controller: signals as EGM messages and as energy."""

from __future__ import annotations

import math
import struct

import numpy as np

from cellwatt.emulation import Signals
from cellwatt.emulation.blocks import Blocks
from cellwatt.emulation.signals import table_of
from cellwatt_drivers.abb.messages import MESSAGES
from cellwatt_drivers.abb.rws import RobotWare
from cellwatt_drivers.abb.wire import DATA

_BLOCK = 50
"""Packets computed at once; a disturbance of the world takes effect after them."""
_DEGREES = math.degrees(1.0)
_PLACE = ("tool.x", "tool.y", "tool.z")
_WRENCH = tuple(f"tool.{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz")


class EmulatedRobot:
    """Creates the packets of a robot with ``axes`` joints, ``period`` s apart; absent signals are 0."""

    def __init__(self, signals: Signals, robotware: RobotWare, axes: int, period: float) -> None:
        self.motors_on = True
        self.running = True
        self._robotware = robotware
        self._axes = axes
        names = [*(f"joint_{i}.position" for i in range(1, axes + 1)), *_PLACE, *_WRENCH]
        scales = np.array([_DEGREES] * axes + [1e3] * len(_PLACE) + [1.0] * len(_WRENCH))
        self._blocks = Blocks(lambda t: table_of(signals.at(t), names, len(t)) * scales, period, _BLOCK)

    def packet(self, index: int, number: int, time: float, clocked: bool = True) -> bytes:
        """Packet ``number`` with the values at ``index`` periods after the epoch.

        ``time`` is the controller's time, s since 1970; ``clocked``: the packet includes it.
        """
        table, row = self._blocks.at(index)
        values: list[float] = table[row].tolist()
        joints, place, wrench = values[: self._axes], values[self._axes : -len(_WRENCH)], values[-len(_WRENCH) :]
        message = MESSAGES.classes["EgmRobot"]()
        message.header.seqno = number & 0xFFFFFFFF
        message.header.tm = round(time * 1e3) & 0xFFFFFFFF
        message.header.mtype = DATA
        message.feedBack.joints.joints.extend(joints)
        message.planned.joints.joints.extend(joints)
        at = message.feedBack.cartesian.pos
        at.x, at.y, at.z = place
        orient = message.feedBack.cartesian.orient
        orient.u0, orient.u1, orient.u2, orient.u3 = 0.0, 0.0, 1.0, 0.0
        if clocked:
            for part in (message.feedBack, message.planned):
                part.time.sec, part.time.usec = divmod(round(time * 1e6), 1_000_000)
        message.motorState.state = 1 if self.motors_on else 2
        message.mciState.state = 3 if self.motors_on else 2
        message.mciConvergenceMet = False
        message.rapidExecState.state = 2 if self.running else 1
        message.utilizationRate = 0.0
        if self._robotware == 7:
            message.moveIndex = index // 250 & 0xFFFFFFFF
            message.measuredForce.fcActive = any(wrench)
            message.measuredForce.force.extend(wrench)
            return bytes(message.SerializeToString())
        # Field 9 of the message as RobotWare 6 encodes it: unpacked doubles of field number 1.
        force = b"".join(b"\x09" + struct.pack("<d", value) for value in wrench)
        return bytes(message.SerializeToString()) + b"\x4a" + bytes([len(force)]) + force


class EnergyMeter:
    """A controller's energy measurement over intervals of ``length`` s since the epoch, J."""

    length = 1.0

    def __init__(self, signals: Signals, axes: int) -> None:
        self.count = 0
        self.interval = 0.0
        self.accumulated = 0.0
        self.joints = [0.0] * axes
        self._signals = signals

    def advance(self, t: float) -> None:
        """Add the intervals that ended before t s; after a pause of minutes only the last 60."""
        ended = math.floor(t / self.length)
        for interval in range(max(self.count, ended - 60), ended):
            self._take(interval)
        self.count = max(self.count, ended)

    def _take(self, interval: int) -> None:
        t = (interval + np.linspace(0.0, 1.0, 51)[:-1]) * self.length
        values = self._signals.at(t)
        power = values.get("supply.power", np.zeros_like(t))
        self.interval = float(power.mean()) * self.length
        self.accumulated += self.interval
        for joint in range(len(self.joints)):
            torque = values.get(f"joint_{joint + 1}.torque", np.zeros_like(t))
            speed = values.get(f"joint_{joint + 1}.velocity", np.zeros_like(t))
            self.joints[joint] = float((torque * speed).mean()) * self.length
