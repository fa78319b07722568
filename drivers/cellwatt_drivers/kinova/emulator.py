"""The Modbus TCP server of an emulated Kinova arm."""

from __future__ import annotations

import math
from collections import Counter
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from cellwatt.arrays import Float
from cellwatt.emulation import Options, PortEmulator, Signals
from cellwatt.emulation.blocks import Blocks
from cellwatt.emulation.signals import table_of
from cellwatt_drivers.kinova import registers
from cellwatt_drivers.kinova.registers import ARM, JOINTS_AND_TOOL, MOST_JOINTS, encode
from cellwatt_drivers.shared.modbus import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE
from cellwatt_drivers.shared.modbus_server import modbus_port

_READ_INPUT = 4
_MOST = 125
_CYCLE = 0.001  # s; an answer holds the values of the arm's last cycle
_BLOCK = 100  # cycles computed at once
_DEG = math.degrees(1.0)


class KinovaEmulator(PortEmulator):
    """A Gen3 with 7 joints: registers 0 to 13 and 34 to 139 as in its published map; any other read is an error.

    Listens on 127.0.0.1:5020 by default. Positions are 0 … 360 degrees, as from real arms. Disturbances, beside those
    of the signals: ``state=NUMBER``, ``fault_flags=NUMBER`` and ``warning_flags=NUMBER``. The supply has the values of
    ``bus.current`` and ``bus.voltage``.

    Faults on answers: ``loss`` (not sent), ``half_frame`` (cut, then silence), ``delay`` (late by ``seconds``),
    ``garbage`` (random bytes before it). At the next request, ``stall`` delays the answer by ``seconds``;
    ``disconnect`` closes the port for ``seconds``. ``made`` counts answers, ``sent`` whole ones, ``refused`` requests
    answered with an error; ``written`` all requests except reads of input registers, which a monitor never sends.
    """

    title: ClassVar[str] = "Kinova Gen3 (Modbus TCP)"
    usual_address: ClassVar[str] = "127.0.0.1:5020"
    changes = MappingProxyType({"state": "number", "fault_flags": "number", "warning_flags": "number"})

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self.arm = EmulatedArm(self.signals)
        self.asked: Counter[tuple[int, int]] = Counter()
        self.tally.update(written=0)
        self.port = modbus_port(self, self._read)

    def change(self, kind: str, value: float | str) -> None:
        """Set state or flags."""
        setattr(self.arm, kind, int(value))

    def _read(self, unit: int, function: int, first: int, count: int) -> list[int] | int:
        if function != _READ_INPUT:
            self.tally["written"] += 1
            return ILLEGAL_FUNCTION
        self.asked[first, count] += 1
        if not 1 <= count <= _MOST:
            return ILLEGAL_VALUE
        for start, length in (ARM, JOINTS_AND_TOOL):
            if start <= first and first + count <= start + length:
                return self.arm.block(start, self.elapsed)[first - start : first - start + count]
        return ILLEGAL_ADDRESS


_MOTION = registers.joints(1.0, MOST_JOINTS, True).stream.channels
_SCALES = np.array([_DEG if channel.unit.startswith("rad") else 1.0 for channel in _MOTION])


class EmulatedArm:
    """Signals as the registers of an arm; absent signals are 0."""

    def __init__(self, signals: Signals) -> None:
        self.state, self.fault_flags, self.warning_flags = 7, 0, 0
        self._signals = signals
        self._blocks = Blocks(self._compute, _CYCLE, _BLOCK)

    def block(self, first: int, t: float) -> list[int]:
        """Return the registers of the block that begins at ``first``, at t s."""
        (supply, motion), row = self._blocks.at(math.floor(t / _CYCLE))
        if first != ARM[0]:
            return encode(motion[row])
        words = [1 << self.state, 0]
        for flags in (self.fault_flags, self.warning_flags):
            words += [flags & 0xFFFF, flags >> 16]
        return words + encode([*supply[row], 45.0, 38.0])

    def _compute(self, t: Float) -> tuple[Float, Float]:
        values = self._signals.at(t)
        motion = table_of(values, [channel.name for channel in _MOTION], len(t)) * _SCALES
        motion[:, :MOST_JOINTS] %= 360.0
        return table_of(values, ("bus.current", "bus.voltage"), len(t)), motion
