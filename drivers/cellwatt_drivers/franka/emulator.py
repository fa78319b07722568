"""An emulated Franka robot: the FCI server of its control unit."""

from __future__ import annotations

import asyncio
import math
import os
import socket
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.driver import SourceSettings
from cellwatt.emulation import Datagrams, Emulator, Options, Signals, TcpPort
from cellwatt.emulation.blocks import Blocks
from cellwatt.emulation.faults import FAULT_KINDS
from cellwatt.emulation.signals import table_of
from cellwatt_drivers.franka import fci

_RATE = 1000.0
_AHEAD = 50  # states computed at once; a disturbance of the world takes effect after them
_PRIORITY = 10
_LONGEST = 1 << 16  # bytes of a client's message
_APART = 0.0004  # s between states due together: a client reads only the newest waiting state
_MOST_APART, _MOST_APART_REALTIME = 20, 500  # most states sent apart; earlier ones are sent in one burst to catch up


class FrankaEmulator(Emulator):
    """FCI version 10 for one client at a time, as on a robot: states at 1 kHz from its connection on.

    Listens on 127.0.0.1:1337 by default (the library supports no other port, but any address). Answers connect and
    getRobotModel; every other command is answered with success and counted as ``commanded``; a monitor never sends one.
    Joint 7 stands still if the signals lack it. Options: ``version`` (10), ``realtime`` (1: real-time priority for this
    process, if permitted, so that states are sent one by one also on a busy PC; clients read only the newest of those
    that arrive together). Disturbances, beside those of the signals: ``mode=NUMBER`` and ``error=0`` or ``1``.

    Faults on states: ``loss``, ``duplicate``, ``reorder`` (held back until after the next), ``delay`` (sent
    ``seconds`` late), ``half_frame`` (cut: the library ends the connection), ``stall`` (nothing is sent for
    ``seconds``, then all at once), ``disconnect`` (the connection ends, none is accepted for ``seconds``),
    ``clock_jump`` (the robot's time jumps ahead). ``made`` counts states for a client, ``sent`` whole ones sent.
    """

    title: ClassVar[str] = "Franka robot (FCI)"
    usual_address: ClassVar[str] = f"127.0.0.1:{fci.PORT}"
    usual_port = fci.PORT
    changes = MappingProxyType({"mode": "number", "error": "number"})
    faults = tuple(kind for kind in FAULT_KINDS if kind != "garbage")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: the library loses states that arrive together."""
        return {"realtime": "1"}

    @classmethod
    def free_address(cls, settings: SourceSettings) -> str:
        """See ``Emulator.free_address``: the library supports one port, so each robot has its own loopback address."""
        for last in range(2, 255):
            with socket.socket() as probe, suppress(OSError):
                probe.bind((f"127.0.77.{last}", fci.PORT))
                return f"127.0.77.{last}:{fci.PORT}"
        raise ValueError(f"port {fci.PORT} is taken at all of 127.0.77.2 to 127.0.77.254; end what listens there")

    @classmethod
    def settings_at(cls, address: str, settings: SourceSettings) -> dict[str, Any]:
        """See ``Emulator.settings_at``."""
        return {"host": address.rpartition(":")[0]}

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self._version = options.whole("version", fci.VERSION)
        self._realtime = options.flag("realtime", False)
        self.robot = EmulatedRobot(self.signals)
        self._connected = False
        self._shift = 0
        self._last_sent = 0.0
        self._most_apart = _MOST_APART
        self.tally.update(commanded=0)
        self._states = Datagrams(self)
        self._port = TcpPort(self, self._talk)

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """See ``Emulator.disturb``."""
        super().disturb(change)
        self.robot.blocks.forget()

    def change(self, kind: str, value: float | str) -> None:
        """Set mode or error."""
        setattr(self.robot, kind, int(value))

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        async with self._port as address:
            if self._realtime:
                with suppress(OSError):  # not every user is permitted
                    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
                    self._most_apart = _MOST_APART_REALTIME
            with self._states.opened(address.rpartition(":")[0]):
                ready(address)
                await self._send_states()

    async def _send_states(self) -> None:
        passed = 0
        async for index, behind in self.cycles(_RATE):
            if behind < self._most_apart:
                self._keep_apart()
            passed += 1
            self._cycle(index, passed)
            self._last_sent = time.monotonic()

    def _keep_apart(self) -> None:
        """Send no state immediately after another, even if several fell due together."""
        pause = self._last_sent + _APART - time.monotonic()
        if pause > 0 and self._states.to is not None:
            time.sleep(pause)  # the loop's timers are coarser than this

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._connected:
            return
        self._connected = True
        try:
            while True:
                command, number, size = fci.HEAD.unpack(await reader.readexactly(fci.HEAD.size))
                payload = await reader.readexactly(min(max(size - fci.HEAD.size, 0), _LONGEST))
                peer = writer.get_extra_info("peername")[0]
                writer.write(self._answer(command, number, payload, peer))
                await writer.drain()
        except struct.error:
            pass  # the client does not speak FCI
        finally:
            self._connected = False
            self._states.to = None

    def _answer(self, command: int, number: int, payload: bytes, peer: str) -> bytes:
        if command == fci.CONNECT:
            version, port = fci.decode_connect(payload)
            if version != self._version:
                return fci.connect_reply(number, fci.INCOMPATIBLE)
            self._states.to = (peer, port)
            return fci.connect_reply(number, fci.SUCCESS)
        if command == fci.GET_ROBOT_MODEL:
            return fci.reply(command, number, fci.SUCCESS, fci.model())
        self.tally["commanded"] += 1
        return fci.reply(command, number, fci.SUCCESS)

    def _cycle(self, index: int, passed: int) -> None:
        if jump := self.injector.once("clock_jump"):
            self._shift += round(jump.seconds * 1e3)
        if outage := self.injector.once("disconnect"):
            self._port.interrupt(outage.seconds)
            self._states.to = None
        if self._states.to is not None:
            self.tally["made"] += 1
            self._states.put(self.robot.state(index, passed + self._shift))


class EmulatedRobot:
    """Signals as the states of a robot; absent signals are 0."""

    def __init__(self, signals: Signals) -> None:
        self.mode, self.error = 2, 0
        self._signals = signals
        self.blocks = Blocks(self._compute, 1 / _RATE, _AHEAD)
        """States computed ahead."""

    def state(self, index: int, time: int) -> bytes:
        """Return the datagram ``index`` ms after the epoch, at the robot's ``time``, ms since its start."""
        states, row = self.blocks.at(index)
        state = states[row : row + 1]
        state["message_id"] = time
        return state.tobytes()

    def _compute(self, t: Float) -> NDArray[np.void]:
        values = self._signals.at(t)
        states = np.zeros(len(t), fci.STATE)
        for field, quantity in _JOINTS.items():
            states[field] = table_of(values, [f"joint_{joint}.{quantity}" for joint in range(1, 8)], len(t))
        for field in ("O_T_EE", "O_T_EE_d", "O_T_EE_c"):
            states[field] = _UPRIGHT
            states[field][:, 12:15] = table_of(values, [f"tool.{axis}" for axis in "xyz"], len(t))
        for field in ("F_T_EE", "EE_T_K", "F_T_NE", "NE_T_EE"):
            states[field] = np.eye(4).ravel()
        states["m_ee"] = 0.73
        states["control_command_success_rate"] = 1.0
        states["robot_mode"] = self.mode
        states["errors"][:, 0] = self.error
        return states


_JOINTS = {
    "q": "position", "q_d": "position", "dq": "velocity", "dq_d": "velocity", "tau_J": "torque",
    "dtau_J": "torque_rate", "theta": "position", "dtheta": "velocity", "tau_ext_hat_filtered": "external_torque",
}  # fmt: skip
_UPRIGHT = np.array([[1, 0, 0, 0], [0, math.cos(math.pi), 0, 0], [0, 0, math.cos(math.pi), 0], [0, 0, 0, 1]]).ravel()
