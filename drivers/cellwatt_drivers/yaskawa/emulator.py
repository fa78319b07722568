"""A Yaskawa controller's High-Speed Ethernet Server: robot division, read services."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from cellwatt.emulation import Datagrams, Emulator, Options
from cellwatt.emulation.datagrams import Address
from cellwatt.emulation.faults import FAULT_KINDS
from cellwatt.emulation.port import host_and_port
from cellwatt.errors import ProtocolError
from cellwatt_drivers.yaskawa import payload, wire
from cellwatt_drivers.yaskawa.emulated_robot import PULSES_PER_DEGREE, RATED_TORQUE, EmulatedRobot

NO_COMMAND, NO_INSTANCE, NOT_REMOTE = 0xA000, 0xA001, 0x2100
ANSWER_MS = {"FS100": 20.0, "DX200": 8.0, "YRC1000": 5.0}
"""Time from request to answer, ms, ± 1 ms of jitter: measured for FS100; 5 to 10 ms reported for the others."""

_JITTER_MS = 1.0
_GENERAL_ERROR = 0x1F
_BUSY = 0xE444
_AXIS_NAMES = ("S", "L", "U", "R", "B", "T", "E", "8")
_POSE_NAMES = ("X", "Y", "Z", "Rx", "Ry", "Rz")


class YaskawaEmulator(Emulator):
    """One controller with one robot (R1) over UDP; listens on 127.0.0.1:10040 by default.

    Options: ``model`` (DX200, YRC1000 or FS100: sets the answer time), ``answer_ms`` (instead of the model's),
    ``pulses_per_degree`` and ``rated_torque`` (Nm at the joint at 100 %; comma-separated), ``busy`` (share of requests
    answered BUSY), ``alarm`` (``CODE:NAME``).

    Services that write are refused: remote is not set.

    Faults on answers: ``loss`` (not sent), ``half_frame`` (cut), ``delay`` (late by ``seconds``), ``reorder`` (held
    until the next one is sent), ``duplicate``, ``garbage`` (random bytes before it). At the next request, ``stall``
    stops reading for ``seconds``, then answers all that waited, and ``disconnect`` closes the port for ``seconds``.
    ``made`` counts valid requests, ``sent`` whole answers sent, ``busy`` answers BUSY, ``malformed`` invalid requests.
    """

    title: ClassVar[str] = "Yaskawa controller (High-Speed Ethernet Server)"
    usual_address: ClassVar[str] = f"127.0.0.1:{wire.PORT}"
    faults = tuple(kind for kind in FAULT_KINDS if kind != "clock_jump")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: short answer times, because emulator and daemon share the PC."""
        if len(sources) > 1 or sources[0].control_group != 1:
            raise ValueError("an emulated controller has one robot, control_group 1")
        settings = sources[0]
        options = {"answer_ms": "2"}
        for name in ("pulses_per_degree", "rated_torque"):
            if numbers := getattr(settings, name):
                options[name] = ",".join(f"{x!r}" for x in numbers)
        return options

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        model = options.choice("model", "YRC1000", tuple(ANSWER_MS))
        self._answer_ms = options.number("answer_ms", ANSWER_MS[model])
        self._jitter_ms = min(_JITTER_MS, self._answer_ms / 2)
        self._busy = options.number("busy", 0.0)
        code, _, name = options.text("alarm").partition(":")
        self.alarm = payload.Alarm(int(code), time="2024/01/01 00:00", name=name) if code or name else payload.Alarm(0)
        pulses = options.numbers("pulses_per_degree", PULSES_PER_DEGREE)
        self.robot = EmulatedRobot(self.signals, pulses, options.numbers("rated_torque", RATED_TORQUE))
        self.system = payload.System("EMULATED", model, "0")
        self.asked: Counter[wire.Request] = Counter()
        self._datagrams = Datagrams(self, take=self._take)
        self._reads: Mapping[int, Callable[[int], bytes | None]] = {
            wire.STATUS: lambda i: self._status() if i == 1 else None,
            wire.AXIS_NAMES: self._axis_names,
            wire.POSITION: self._position,
            wire.TORQUE: lambda i: payload.encode_axes(self.robot.torques(self.elapsed)) if i == 1 else None,
            wire.ALARM: lambda i: payload.encode_alarm(self.alarm if i == 1 else payload.Alarm(0)) if i < 5 else None,
            wire.SYSTEM: lambda i: payload.encode_system(self.system) if i == 11 else None,
        }

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        with self._datagrams.opened(*host_and_port(self.address)) as address:
            ready(address)
            await asyncio.get_running_loop().create_future()

    def _take(self, datagram: bytes, peer: Address) -> None:
        if outage := self.injector.once("disconnect"):
            self._datagrams.interrupt(outage.seconds)
            return
        try:
            request, number = wire.decode_request(datagram)
        except ProtocolError:
            self.tally["malformed"] += 1
            return
        self.tally["made"] += 1
        self.asked[request] += 1
        if self.injector.chance() < self._busy:
            self.tally["busy"] += 1
            answer = _refusal(request, number, _BUSY)
        else:
            answer = self._answer(request, number)
        after = self._answer_ms + (2 * self.injector.chance() - 1) * self._jitter_ms
        self._datagrams.put(wire.encode_answer(answer), peer, after * 1e-3)

    def _answer(self, request: wire.Request, number: int) -> wire.Answer:
        if request.service in wire.SET:
            return _refusal(request, number, NOT_REMOTE)
        read = self._reads.get(request.command) if request.service == wire.GET_ALL else None
        if read is None:
            return _refusal(request, number, NO_COMMAND)
        data = read(request.instance)
        if data is None:
            return _refusal(request, number, NO_INSTANCE)
        return wire.Answer(number, request.service | wire.ANSWER, 0, 0, data)

    def _axis_names(self, instance: int) -> bytes | None:
        names = {1: _AXIS_NAMES[: self.robot.axes], 101: _POSE_NAMES}.get(instance)
        return None if names is None else payload.encode_axis_names(names)

    def _status(self) -> bytes:
        alarm = ("alarm",) if self.alarm.code else ()
        return payload.encode_status("automatic", "running", "play", "remote", "servo_on", *alarm)

    def _position(self, instance: int) -> bytes | None:
        if instance == 1:
            return payload.encode_position(payload.PULSE, self.robot.pulses(self.elapsed))
        if instance == 101:
            return payload.encode_position(payload.BASE, self.robot.pose(self.elapsed))
        return None


def _refusal(request: wire.Request, number: int, added: int) -> wire.Answer:
    return wire.Answer(number, request.service | wire.ANSWER, _GENERAL_ERROR, added)
