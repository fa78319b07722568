"""An emulated ABB controller: sends EGM packets and serves Robot Web Services."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from typing import ClassVar

from cellwatt.emulation import Datagrams, Emulator, Signals, TcpPort
from cellwatt.emulation.faults import FaultKind
from cellwatt.ticker import Ticker
from cellwatt_drivers.abb import emulated_pages
from cellwatt_drivers.abb.emulated_pages import Pages
from cellwatt_drivers.abb.emulated_robot import EmulatedRobot, Meter, Stamp
from cellwatt_drivers.abb.rws import RobotWare
from cellwatt_drivers.abb.wire import CYCLE, PORT

_WORDS = {200: "OK", 401: "Unauthorized", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}
_LONGEST_HEAD = 16384


class AbbEmulator(Emulator):
    """One robot: EGM packets to a port of the listener's, and the controller's web pages.

    The address is that of the pages (127.0.0.1:8080 unless told otherwise). Options: ``egm`` (where packets go:
    127.0.0.1:6510), ``robotware`` (7, or 6), ``rate`` (250 Hz, or a whole part, as a number), ``axes`` (6), ``clock``
    (1; 0 leaves the controller's time out), ``user`` and ``password`` (Default User, robotics), ``certificate`` (file
    with key and certificate: pages over HTTPS), ``energy`` (yes; no: there is no page of energy). Pages are XHTML, or
    JSON (RobotWare 6: ``?json=1``, 7: ``Accept: application/hal+json;v=2.0``). A disturbance ``motors=off``,
    ``program=off`` (or ``on``) or ``session=1`` (numbering begins anew) is the controller's; all others are the
    signals'.

    Faults on EGM packets: ``loss``, ``duplicate``, ``reorder`` (held back until after the next), ``delay`` (sent
    ``seconds`` late), ``half_frame`` (cut), ``garbage`` (a datagram of random bytes ahead), ``stall`` (nothing leaves
    for ``seconds``, then all at once), ``disconnect`` (nothing is made for ``seconds``, pages are refused),
    ``clock_jump`` (the controller's time jumps). ``made`` counts packets, ``sent`` whole ones; ``heard`` counts
    datagrams that came back, which a monitor never sends.
    """

    title: ClassVar[str] = "ABB controller (EGM and Robot Web Services)"
    faults: ClassVar[tuple[FaultKind, ...]] = (
        "delay",
        "reorder",
        "duplicate",
        "loss",
        "garbage",
        "half_frame",
        "stall",
        "disconnect",
        "clock_jump",
    )

    def __init__(
        self,
        signals: Signals,
        address: str,
        *,
        epoch: float | None = None,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(signals, address or "127.0.0.1:8080", epoch=epoch, seed=seed, options=options)
        left = dict(self.options)
        host, _, port = left.pop("egm", f"127.0.0.1:{PORT}").rpartition(":")
        self._to = (host, int(port))
        robotware = _robotware(left.pop("robotware", "7"))
        self._rate = float(left.pop("rate", 1 / CYCLE))
        axes = int(left.pop("axes", "6"))
        self._clocked = left.pop("clock", "1") == "1"
        user, password = left.pop("user", "Default User"), left.pop("password", "robotics")
        certificate = left.pop("certificate", "")
        measures = left.pop("energy", "yes") == "yes"
        if left:
            raise ValueError(f"unknown options: {', '.join(left)}")
        self.robot = EmulatedRobot(signals, robotware, axes, 1 / self._rate)
        meter = Meter(signals, axes) if measures else None
        self.pages = Pages(self.robot, meter, robotware, user, password, lambda: time.time() - self.epoch)
        self.signals = _World(signals, self)
        self._number = 0
        self._shift = 0.0
        self._down_until = 0.0
        self.tally.update(heard=0)
        self._packets = Datagrams(self, _header, _no_message)
        self._port = TcpPort(self, self._talk, emulated_pages.tls(certificate) if certificate else None)

    def begin_session(self) -> None:
        """The program starts EGM anew: packets are numbered from 0."""
        self._number = 0

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        async with self._port as address:
            with self._packets.opened(address.rpartition(":")[0]):
                self._packets.to = self._to
                ready(address)
                await self._send_packets()

    async def _send_packets(self) -> None:
        first = round((time.time() - self.epoch) * self._rate)
        index = 0
        async with Ticker(self._rate) as ticker:
            async for beat in ticker:
                self.tally["heard"] += self._packets.heard()
                for _ in range(beat.merged + 1):
                    self._cycle(first + index)
                    index += 1

    def _cycle(self, index: int) -> None:
        now = time.monotonic()
        if outage := self.injector.once("disconnect"):
            self._down_until = now + outage.seconds
            self._port.interrupt(outage.seconds)
        if now < self._down_until:
            return
        if jump := self.injector.once("clock_jump"):
            self._shift += jump.seconds
        self.tally["made"] += 1
        self._number += 1
        stamp = Stamp(self._number, self.epoch + index / self._rate + self._shift, self._clocked)
        self._packets.put(self.robot.packet(index, stamp))

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await self._exchange(reader, writer):
            pass

    async def _exchange(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        head = await reader.readuntil(b"\r\n\r\n")
        if len(head) > _LONGEST_HEAD:
            return False
        request, *lines = head.decode("latin-1").split("\r\n")
        fields = {k.strip().lower(): v.strip() for k, _, v in (line.partition(":") for line in lines if line)}
        await reader.readexactly(min(int(fields.get("content-length", "0")), _LONGEST_HEAD))
        method, path, *_ = [*request.split(" "), "", ""]
        status, headers, body = self.pages.answer(method, path, fields)
        headers = {"Content-Type": "application/xhtml+xml;v=2.0", "Content-Length": str(len(body))} | headers
        text = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
        writer.write(f"HTTP/1.1 {status} {_WORDS[status]}\r\n{text}\r\n".encode("latin-1") + body)
        await writer.drain()
        return fields.get("connection", "").lower() != "close"


class _World:
    """The signals, and what can happen to the controller itself."""

    def __init__(self, signals: Signals, emulator: AbbEmulator) -> None:
        self.at = signals.at
        self._signals = signals
        self._emulator = emulator

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Motors, program, numbering, or a change of the signals."""
        if "motors" in change:
            self._emulator.robot.motors_on = change["motors"] == "on"
        elif "program" in change:
            self._emulator.robot.running = change["program"] == "on"
        elif "session" in change:
            self._emulator.begin_session()
        else:
            self._signals.disturb(change)


def _header(packet: bytes) -> int:
    """A half packet ends in the header: one cut between two later fields would be a shorter, good one."""
    return packet[1] + 2


def _no_message(garbage: bytes) -> bytes:
    """With a wire type ahead that protobuf does not have, so that no random datagram is a message by chance."""
    return b"\x07" + garbage


def _robotware(text: str) -> RobotWare:
    if text not in ("6", "7"):
        raise ValueError(f"robotware is 6 or 7, not {text!r}")
    return 6 if text == "6" else 7
