"""An emulated ABB controller: sends EGM packets and serves Robot Web Services."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

from cellwatt.emulation import Datagrams, Emulator, Options, TcpPort
from cellwatt.emulation.faults import FAULT_KINDS
from cellwatt.emulation.port import host_and_port
from cellwatt_drivers.abb import emulated_pages
from cellwatt_drivers.abb.emulated_pages import Pages
from cellwatt_drivers.abb.emulated_robot import EmulatedRobot, EnergyMeter
from cellwatt_drivers.abb.rws import RobotWare
from cellwatt_drivers.abb.wire import CYCLE, PORT

_WORDS = {200: "OK", 401: "Unauthorized", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}
_LONGEST_HEAD = 16384


class AbbEmulator(Emulator):
    """One robot: EGM packets to a listener's port, and the controller's web pages.

    The address is that of the pages (127.0.0.1:8080 by default). Options: ``egm`` (receiver of packets:
    127.0.0.1:6510), ``robotware`` (7, or 6), ``rate`` (a number: 250 Hz, or 250 Hz divided by a whole number), ``axes``
    (6), ``user`` and ``password`` (Default User, robotics; an empty password: any is accepted), ``certificate`` (file
    with key and certificate: pages over HTTPS), ``energy`` (yes; no: there is no page of energy). A disturbance
    ``motors=off``, ``program=off`` (or ``on``) or ``session=1`` (packet numbers restart) changes the controller; all
    others change the signals.

    Faults on EGM packets: ``loss``, ``duplicate``, ``reorder`` (held back until after the next), ``delay`` (sent
    ``seconds`` late), ``half_frame`` (cut), ``garbage`` (a datagram of random bytes first), ``stall`` (nothing is sent
    for ``seconds``, then all at once), ``disconnect`` (no packets for ``seconds``, pages are refused), ``clock_jump``
    (the controller's time jumps). ``made`` counts packets, ``sent`` whole ones; ``heard`` counts datagrams received
    from the listener, which a monitor never sends.
    """

    title: ClassVar[str] = "ABB controller (EGM and Robot Web Services)"
    usual_address: ClassVar[str] = "127.0.0.1:8080"
    changes = MappingProxyType({"motors": "to", "program": "to", "session": "number"})
    faults = FAULT_KINDS

    @classmethod
    def address_in(cls, settings: Any) -> str:
        """See ``Emulator.address_in``: the address of the pages."""
        return f"{settings.host}:{settings.web_port}"

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``."""
        if len(sources) > 1:
            raise ValueError("an emulated controller has one robot")
        settings = sources[0]
        return {
            "egm": f"127.0.0.1:{settings.egm_port}",
            "robotware": str(settings.robotware),
            "rate": f"{settings.rate!r}",
            "axes": str(settings.axes),
            "user": settings.user,
            "password": "",  # the settings' password must not appear on a command line
        }

    @classmethod
    def settings_at(cls, address: str, settings: Any) -> dict[str, Any]:
        """See ``Emulator.settings_at``: its pages are plain HTTP, its packets go to a loopback address."""
        local = {} if settings.bind in ("0.0.0.0", "127.0.0.1") else {"bind": "127.0.0.1"}
        return {**super().settings_at(address, settings), "tls": False, **local}

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self._to = host_and_port(options.text("egm", f"127.0.0.1:{PORT}"))
        robotware: RobotWare = 6 if options.choice("robotware", "7", ("6", "7")) == "6" else 7
        self._rate = options.number("rate", 1 / CYCLE)
        axes = options.whole("axes", 6)
        user, password = options.text("user", "Default User"), options.text("password", "robotics")
        certificate = options.text("certificate")
        measures = options.flag("energy", True)
        self.robot = EmulatedRobot(self.signals, robotware, axes, 1 / self._rate)
        meter = EnergyMeter(self.signals, axes) if measures else None
        self.pages = Pages(self.robot, meter, robotware, user, password, lambda: self.elapsed)
        self._number = 0
        self._shift = 0.0
        self._down_until = 0.0
        self.tally.update(heard=0)
        # Protobuf has no wire type 7: with it, no random datagram is a valid message.
        self._packets = Datagrams(self, _header, lambda noise: b"\x07" + noise, lambda *_: self.tally.update(heard=1))
        self._port = TcpPort(self, self._talk, emulated_pages.tls(certificate) if certificate else None)

    def change(self, kind: str, value: float | str) -> None:
        """Set motors or program, or restart packet numbers at 0."""
        if kind == "motors":
            self.robot.motors_on = value == "on"
        elif kind == "program":
            self.robot.running = value == "on"
        else:
            self._number = 0

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        async with self._port as address:
            with self._packets.opened(address.rpartition(":")[0]):
                self._packets.to = self._to
                ready(address)
                async for index, _ in self.cycles(self._rate):
                    self._cycle(index)

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
        controllers_time = self.epoch + index / self._rate + self._shift
        self._packets.put(self.robot.packet(index, self._number, controllers_time))

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        fields: dict[str, str] = {}
        while fields.get("connection", "").lower() != "close":
            head = await reader.readuntil(b"\r\n\r\n")
            if len(head) > _LONGEST_HEAD:
                return
            request, *lines = head.decode("latin-1").split("\r\n")
            fields = {k.strip().lower(): v.strip() for k, _, v in (line.partition(":") for line in lines if line)}
            await reader.readexactly(min(int(fields.get("content-length", "0")), _LONGEST_HEAD))
            method, path, *_ = [*request.split(" "), "", ""]
            status, headers, body = self.pages.answer(method, path, fields)
            headers = {"Content-Type": "application/xhtml+xml;v=2.0", "Content-Length": str(len(body))} | headers
            text = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
            writer.write(f"HTTP/1.1 {status} {_WORDS[status]}\r\n{text}\r\n".encode("latin-1") + body)
            await writer.drain()


def _header(packet: bytes) -> int:
    """Cut a half packet within its header: a packet cut between two later fields would be valid."""
    return packet[1] + 2
