"""An emulated ABB controller: sends EGM packets and serves Robot Web Services."""

from __future__ import annotations

import asyncio
import socket
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import ClassVar

from cellwatt.emulation import Emulator, Signals
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
    with key and certificate: pages over HTTPS). A disturbance ``motors=off``, ``program=off`` (or ``on``) or
    ``session=1`` (numbering begins anew) is the controller's; all others are the signals'.

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
        if left:
            raise ValueError(f"unknown options: {', '.join(left)}")
        self._tls = emulated_pages.tls(certificate) if certificate else None
        self.robot = EmulatedRobot(signals, robotware, axes, 1 / self._rate)
        meter = Meter(signals, axes)
        self.pages = Pages(self.robot, meter, robotware, user, password, lambda: time.time() - self.epoch)
        self.signals = _World(signals, self)
        self._number = 0
        self._shift = 0.0
        self._held: list[bytes] = []
        self._stalled: list[bytes] = []
        self._stalled_until = 0.0
        self._down_until = 0.0
        self._counts = Counter(made=0, sent=0, heard=0)
        self._writers: set[asyncio.StreamWriter] = set()

    @property
    def counts(self) -> Mapping[str, int]:
        """See ``Emulator.counts``."""
        return {**self._counts, **self.injector.counts}

    def begin_session(self) -> None:
        """The program starts EGM anew: packets are numbered from 0."""
        self._number = 0

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        host, _, port = self.address.rpartition(":")
        server = await asyncio.start_server(self._accept, host, int(port), ssl=self._tls)
        bound: tuple[str, int] = server.sockets[0].getsockname()[:2]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.bind((host, 0))
            ready(f"{bound[0]}:{bound[1]}")
            try:
                await self._send_packets(sender)
            finally:
                server.close()
                for writer in list(self._writers):
                    writer.close()
                await asyncio.sleep(0)

    async def _send_packets(self, sender: socket.socket) -> None:
        first = round((time.time() - self.epoch) * self._rate)
        index = 0
        async with Ticker(self._rate) as ticker:
            async for beat in ticker:
                self._hear(sender)
                for _ in range(beat.merged + 1):
                    self._cycle(sender, first + index)
                    index += 1

    def _hear(self, sender: socket.socket) -> None:
        try:
            sender.recvfrom(2048)
        except OSError:  # nothing came, or word that nobody listens
            return
        self._counts["heard"] += 1

    def _cycle(self, sender: socket.socket, index: int) -> None:
        now = time.monotonic()
        if outage := self.injector.once("disconnect"):
            self._down_until = now + outage.seconds
        if now < self._down_until:
            return
        if jump := self.injector.once("clock_jump"):
            self._shift += jump.seconds
        if stall := self.injector.once("stall"):
            self._stalled_until = now + stall.seconds
        self._counts["made"] += 1
        self._number += 1
        stamp = Stamp(self._number, self.epoch + index / self._rate + self._shift, self._clocked)
        self._dispatch(sender, self.robot.packet(index, stamp), now)

    def _dispatch(self, sender: socket.socket, packet: bytes, now: float) -> None:
        strikes = self.injector.strikes
        if strikes("loss", now):
            return
        if strikes("half_frame", now):
            # Within the header: a message cut between two later fields would be a shorter, good one.
            self._put(sender, packet[: 1 + self.injector.below(packet[1] + 1)], now, 0)
            return
        if strikes("reorder", now):
            self._held.append(packet)
            return
        if late := strikes("delay", now):
            asyncio.get_running_loop().call_later(late.seconds, self._put, sender, packet, now, 1)
            return
        if strikes("garbage", now):
            # A wire type that protobuf does not have, so that no random datagram is a message by chance.
            self._put(sender, b"\x07" + self.injector.random_bytes(0, 200), now, 0)
        self._put(sender, packet, now, 1)
        if strikes("duplicate", now):
            self._put(sender, packet, now, 0)
        held, self._held = self._held, []
        for older in held:
            self._put(sender, older, now, 1)

    def _put(self, sender: socket.socket, packet: bytes, now: float, whole: int) -> None:
        self._counts["sent"] += whole
        if now < self._stalled_until:
            self._stalled.append(packet)
            return
        waiting, self._stalled = self._stalled, []
        for each in (*waiting, packet):
            try:
                sender.sendto(each, self._to)
            except OSError:  # nobody listens
                self._counts["unheard"] += 1

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            while await self._exchange(reader, writer):
                pass
        except (ConnectionError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.CancelledError):
            pass  # the client left, or the emulator ends
        finally:
            self._writers.discard(writer)
            writer.close()

    async def _exchange(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        head = await reader.readuntil(b"\r\n\r\n")
        if time.monotonic() < self._down_until or len(head) > _LONGEST_HEAD:
            return False
        request, *lines = head.decode("latin-1").split("\r\n")
        fields = {k.strip().lower(): v.strip() for k, _, v in (line.partition(":") for line in lines if line)}
        await reader.readexactly(min(int(fields.get("content-length", "0")), _LONGEST_HEAD))
        method, path, *_ = [*request.split(" "), "", ""]
        status, headers, body = self.pages.answer(
            method, path.partition("?")[0], fields.get("authorization", ""), fields.get("cookie", "")
        )
        headers |= {"Content-Type": "application/xhtml+xml;v=2.0", "Content-Length": str(len(body))}
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


def _robotware(text: str) -> RobotWare:
    if text not in ("6", "7"):
        raise ValueError(f"robotware is 6 or 7, not {text!r}")
    return 6 if text == "6" else 7
