"""An emulated IVT-S and a driver on one loop."""

from __future__ import annotations

import socket
import time
from collections import deque
from contextlib import AbstractAsyncContextManager

import can

from cellwatt_drivers.can_sensor import CanSensorDriver, CanSensorSettings
from cellwatt_drivers.can_sensor.emulator import CanSensorEmulator

from ..inlet import CollectingInlet
from ..running import Run, Served, Steady, repeated, with_address

FAST = {"cycles": "current=10,voltage_1=20"}
READ = {"read": ["current", "voltage_1"], "rates": {"current": "100 Hz", "voltage_1": "50 Hz"}}


STILL = Steady({"bus.voltage": 48.0, "bus.current": -2.5})


class ScriptedBus(can.BusABC):
    """A bus of the kernel, on which a test puts frames."""

    def __init__(self) -> None:
        self._near, self._far = socket.socketpair()
        self._near.setblocking(False)
        self._far.setblocking(False)
        self._waiting: deque[can.Message] = deque()
        self._is_shutdown = True

    def put(self, *messages: can.Message) -> None:
        for message in messages:
            message.timestamp = message.timestamp or time.time()
            self._waiting.append(message)
            self._far.send(b"!")

    def fileno(self) -> int:
        return self._near.fileno()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._waiting:
            return None, True
        self._near.recv(1)
        return self._waiting.popleft(), True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise AssertionError("the driver only listens")

    def shutdown(self) -> None:
        pass

    def close(self) -> None:
        self._near.close()
        self._far.close()


KERNEL = "socketcan:can0"


def emulated(**options: str) -> Served[CanSensorEmulator]:
    """An emulator and the path of its adapter."""
    return with_address(CanSensorEmulator(STILL, "pty", seed=5, options=FAST | options))


def settings(place: str, **changes: object) -> CanSensorSettings:
    kind, _, rest = place.partition(":")
    if place.startswith("/"):
        base: dict[str, object] = {"interface": "slcan", "channel": place}
    else:
        base = {"interface": kind, "channel": rest}
    if "map" not in changes:
        base |= {"sensor": "ivt_s", **READ}
    return CanSensorSettings.model_validate(base | changes)


def running(wanted: CanSensorSettings) -> AbstractAsyncContextManager[Run[CanSensorDriver]]:
    return repeated(CanSensorDriver("battery", wanted, CollectingInlet()))
