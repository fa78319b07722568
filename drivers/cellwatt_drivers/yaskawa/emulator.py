"""A Yaskawa controller's High-Speed Ethernet Server: robot division, read services."""

from __future__ import annotations

import asyncio
import struct
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from cellwatt.emulation import Datagrams, Emulator, Options
from cellwatt.emulation.datagrams import Address
from cellwatt.emulation.faults import FaultKind
from cellwatt.emulation.port import host_and_port
from cellwatt.errors import ProtocolError
from cellwatt_drivers.yaskawa import payload, wire
from cellwatt_drivers.yaskawa.emulated_robot import PULSES_PER_DEGREE, RATED_TORQUE, EmulatedRobot

SIZES = {0x78: 1, 0x79: 2, 0x7A: 1, 0x7B: 2, 0x7C: 4, 0x7D: 4, 0x7E: 16, 0x7F: 52, 0x80: 36, 0x81: 36}
"""Command that reads one → bytes of it: I/O, register, B, I, D, R, S, P, BP and EX variable."""
_PLURAL = 0x288
"""The command that reads several is that much above the one that reads one."""
_COUNT = struct.Struct("<I")
_LONGEST = wire.LONGEST - wire.HEADER_SIZE - _COUNT.size

NO_COMMAND, NO_INSTANCE, BAD_SIZE = 0xA000, 0xA001, 0xB003


class Memory:
    """All of it is 0 but for ``values``: by command and number, as bytes."""

    def __init__(self) -> None:
        self.values: dict[tuple[int, int], bytes] = {}

    def one(self, command: int, number: int) -> bytes | None:
        """The value with this number; ``None`` where the command reads no memory."""
        size = SIZES.get(command)
        return None if size is None else self.values.get((command, number), bytes(size))

    def several(self, command: int, first: int, data: bytes) -> bytes | int:
        """Answer to a plural read: the count and the values from ``first`` on, or the added status of a refusal.

        What takes a byte is read in pairs.
        """
        single = command - _PLURAL
        size = SIZES.get(single)
        if size is None:
            return NO_COMMAND
        if len(data) != _COUNT.size:
            return BAD_SIZE
        (count,) = _COUNT.unpack(data)
        if not 0 < count <= _LONGEST // size or (size == 1 and count % 2):
            return BAD_SIZE
        numbers = range(first, first + count)
        return data + b"".join(self.values.get((single, n), bytes(size)) for n in numbers)


ANSWER_MS = {"FS100": 20.0, "DX200": 8.0, "YRC1000": 5.0}
"""From request to answer, of which ± 1 ms is jitter: measured for FS100, 5 to 10 ms by word of mouth for the others."""

_JITTER_MS = 1.0
_POSITION_ERROR = 0x76
_GENERAL_ERROR = 0x1F
_BUSY, _NOT_REMOTE, _NO_ATTRIBUTE = 0xE444, 0x2100, 0xA002
_HISTORY, _JOB, _TIMES = 0x71, 0x73, 0x88
_JOB_DATA = struct.pack("<32s3I", b"EMULATED", 0, 0, 10000)
_TIMES_DATA = struct.pack("<16s12s", b"2024/01/01 00:00", b"000001:00'00")
_AXIS_NAMES = ("S", "L", "U", "R", "B", "T", "E", "8")
_POSE_NAMES = ("X", "Y", "Z", "Rx", "Ry", "Rz")
_UNDOCUMENTED_BIT = b"\x00\x00\x01\x00"


class YaskawaEmulator(Emulator):
    """One controller with one robot (R1) over UDP; listens on 127.0.0.1:10040 unless told otherwise.

    Options: ``model`` (DX200, YRC1000 or FS100: how long an answer takes), ``answer_ms`` (instead of the
    model's), ``pulses_per_degree`` and ``rated_torque`` (Nm at the joint at 100 %; comma-separated), ``answer_axes``
    (6, 7 or 8: positions of 44, 48 or 52 bytes), ``busy`` (share of requests answered BUSY), ``status_noise``
    (1: a status bit nobody documents is set), ``alarm`` (``CODE:NAME``), ``torque`` (``int32``, or ``float``, as
    Yaskawa's own dissector shows it).

    Beside what the driver asks for it has alarm history, job, times, and ``memory`` (I/O, registers, variables), whose
    plural reads it answers. Services that write are refused: remote is not set.

    Faults on answers: ``loss`` (not sent), ``half_frame`` (cut), ``delay`` (late by ``seconds``), ``reorder``
    (held until the next one has left), ``duplicate``, ``garbage`` (random bytes ahead of it). At the next
    request, ``stall`` stops reading for ``seconds``, then answers all that waited, and ``disconnect`` closes
    the port for ``seconds``. ``made`` counts the requests understood, ``sent`` whole answers on the wire,
    ``busy`` answers BUSY, ``malformed`` requests that are none.
    """

    title: ClassVar[str] = "Yaskawa controller (High-Speed Ethernet Server)"
    usual_address: ClassVar[str] = f"127.0.0.1:{wire.PORT}"
    usual_port = wire.PORT
    faults: ClassVar[tuple[FaultKind, ...]] = (
        "delay", "reorder", "duplicate", "loss", "garbage", "half_frame", "stall", "disconnect",
    )  # fmt: skip

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: it answers fast, as the daemon that asks shares its PC."""
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
        self._noisy = options.flag("status_noise", False)
        self._floats = options.choice("torque", "int32", ("int32", "float")) == "float"
        self.alarm = _alarm(options.text("alarm"))
        self.robot = EmulatedRobot(
            self.signals,
            options.numbers("pulses_per_degree", PULSES_PER_DEGREE),
            options.numbers("rated_torque", RATED_TORQUE),
            options.whole("answer_axes", 8),
        )
        self.system = payload.System("EMULATED", model, "0")
        self.memory = Memory()
        self.asked: Counter[wire.Request] = Counter()
        self._datagrams = Datagrams(self, take=self._take)
        self._reads = self._tables()

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
            answer = self._answer(request, number, datagram[wire.HEADER_SIZE :])
        after = self._answer_ms + (2 * self.injector.chance() - 1) * self._jitter_ms
        self._datagrams.put(wire.encode_answer(answer), peer, after * 1e-3)

    def _answer(self, request: wire.Request, number: int, asked: bytes) -> wire.Answer:
        if request.service == wire.GET_PLURAL:
            found = self.memory.several(request.command, request.instance, asked)
        else:
            found = self._single(request)
        if isinstance(found, int):
            return _refusal(request, number, found)
        return wire.Answer(number, request.service | wire.ANSWER, 0, 0, found)

    def _single(self, request: wire.Request) -> bytes | int:
        """Return the data of one read, or the added status of a refusal."""
        if request.service in wire.SET:
            return _NOT_REMOTE
        if request.service not in (wire.GET_ALL, wire.GET_ONE):
            return NO_COMMAND
        if (value := self.memory.one(request.command, request.instance)) is not None:
            return value
        read = self._reads.get(request.command)
        if read is None:
            return NO_COMMAND
        data = read(request.instance)
        if data is None:
            return NO_INSTANCE
        if request.service == wire.GET_ONE:
            data = data[4 * (request.attribute - 1) : 4 * request.attribute] if request.attribute else b""
        return data or _NO_ATTRIBUTE

    def _tables(self) -> Mapping[int, Callable[[int], bytes | None]]:
        return {
            wire.STATUS: lambda i: self._status() if i == 1 else None,
            wire.AXIS_NAMES: self._axis_names,
            wire.POSITION: self._position,
            _POSITION_ERROR: lambda i: payload.encode_axes((0,) * 8) if i == 1 else None,
            wire.TORQUE: lambda i: self._torque() if i == 1 else None,
            wire.ALARM: lambda i: payload.encode_alarm(self.alarm if i == 1 else payload.Alarm(0)) if i < 5 else None,
            _HISTORY: lambda i: payload.encode_alarm(payload.Alarm(0)) if i else None,
            _JOB: lambda i: _JOB_DATA if i == 1 else None,
            _TIMES: lambda i: _TIMES_DATA if i else None,
            wire.SYSTEM: lambda i: payload.encode_system(self.system) if i == 11 else None,
        }

    def _axis_names(self, instance: int) -> bytes | None:
        names = {1: _AXIS_NAMES[: self.robot.axes], 101: _POSE_NAMES}.get(instance)
        return None if names is None else payload.encode_axis_names(names)

    def _status(self) -> bytes:
        mode = payload.Mode.AUTOMATIC | payload.Mode.RUNNING | payload.Mode.PLAY | payload.Mode.REMOTE
        state = payload.State.SERVO_ON | (payload.State.ALARM if self.alarm.code else payload.State(0))
        data = payload.encode_status(payload.Status(mode, state))
        return bytes(a | b for a, b in zip(data, _UNDOCUMENTED_BIT * 2, strict=True)) if self._noisy else data

    def _torque(self) -> bytes:
        counts = self.robot.torques(self._now())
        return struct.pack(f"<{len(counts)}f", *counts) if self._floats else payload.encode_axes(counts)

    def _position(self, instance: int) -> bytes | None:
        if instance == 1:
            return payload.encode_position(payload.Position(payload.PULSE, self.robot.pulses(self._now())))
        if instance == 101:
            return payload.encode_position(payload.Position(payload.BASE, self.robot.pose(self._now())))
        return None

    def _now(self) -> float:
        return time.time() - self.epoch


def _refusal(request: wire.Request, number: int, added: int) -> wire.Answer:
    return wire.Answer(number, request.service | wire.ANSWER, _GENERAL_ERROR, added)


def _alarm(text: str) -> payload.Alarm:
    code, _, name = text.partition(":")
    return payload.Alarm(int(code), time="2024/01/01 00:00", name=name) if text else payload.Alarm(0)
