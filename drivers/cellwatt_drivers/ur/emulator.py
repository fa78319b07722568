"""An emulated Universal Robots controller: the RTDE server of PolyScope."""

from __future__ import annotations

import asyncio
import math
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from cellwatt.arrays import Float
from cellwatt.emulation import Emulator, Injector, Options, RecordedSignals, TcpPort
from cellwatt.emulation.blocks import Blocks
from cellwatt.ticker import Ticker
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.emulated_client import EmulatedClient, Listener
from cellwatt_drivers.ur.emulated_samples import Cycles, Encoder, Rows, Samples
from cellwatt_drivers.ur.fields import cycle_rate, decimation
from cellwatt_drivers.ur.wire import ControllerVersion

AHEAD = 0.05
"""s of packages made at once; a disturbance of the world discards them."""
UNREAD = 10.0
"""s of packages that a client may leave unread before the controller closes the connection, as a real one does."""
LOOKS = 500.0
"""Rate, Hz, at which faults are checked between the rows of a recording."""


class UrEmulator(Emulator):
    """RTDE version 2 over TCP for several clients, e-Series or CB3.

    Serves channels (``joint_1.position``) or RTDE columns (``actual_q_0``) of its signals; a recording is sent row by
    row at its recorded times with its recorded timestamps, whatever rate a client requests, from the first client's
    start on. All fields not in the signals have plausible constants. Protocol version 1 is refused.

    Options: ``polyscope`` (``5.12.0``; 3.x is a CB3 with 125 Hz) · ``at_end`` of a recording: ``pause`` stops sending,
    ``hold`` repeats the last row · ``start`` of a recording: ``client`` with the first client, ``epoch`` at the epoch.

    Faults: ``loss`` a package is never sent · ``delay`` a package and all after it wait, as on a stalled network ·
    ``stall`` the same once · ``disconnect`` all connections end, and new ones are refused for that time ·
    ``half_frame`` half a package, then the end · ``garbage`` bytes that are not RTDE, then silence until the client
    disconnects · ``clock_jump`` the timestamps shift. Disturbances, beside those of the signals: ``reboot=S`` (down for
    S seconds, timestamps start from 0) and ``message=TEXT`` (a text message to all clients).

    Counts: ``made`` is the number of packages due to listeners since their start, including while they were
    disconnected; ``sent`` the number written to a connection. A client that requests only the timestamp compares
    clocks: its packages are not counted, and no fault of single packages strikes them.
    """

    title = "Universal Robots controller (RTDE)"
    usual_address = "127.0.0.1:30004"
    faults = ("loss", "delay", "stall", "disconnect", "half_frame", "garbage", "clock_jump")
    changes = MappingProxyType({"reboot": "seconds", "message": "text"})

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self.version = _version(options.text("polyscope", "5.12.0"))
        hold = options.choice("at_end", "pause", ("pause", "hold")) == "hold"
        self._start = options.choice("start", "client", ("client", "epoch"))
        self._port = TcpPort(self, self._talk)
        self._rows = Rows(self.signals, hold) if isinstance(self.signals, RecordedSignals) else None
        self.clients: set[EmulatedClient] = set()
        self._listeners: list[Listener] = []
        self._samples: Samples | None = None
        self._began = 0.0  # monotonic time of the samples' start
        self._shift = 0.0  # of the timestamps, s
        self._outage = 0.0  # s for which the port is to be closed

    @property
    def counts(self) -> Mapping[str, int]:
        """See ``Emulator`` and the class."""
        self.advance()
        return super().counts

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """See ``Emulator.disturb``; also discards packages made ahead."""
        super().disturb(change)
        self._forget()

    def change(self, kind: str, value: float | str) -> None:
        """Reboot, or send a text message to all clients."""
        if kind == "reboot":
            self._reboot(float(value))
            return
        for client in self.clients:
            client.put(wire.text_message(wire.TextMessage(str(value), "emulator", 2)))
            self.tally["message"] += 1

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator``."""
        rate = cycle_rate(self.version) if self._rows is None else LOOKS
        async with Ticker(rate) as ticker:
            first = await anext(ticker)
            if self._rows is None:
                late = (time.monotonic_ns() - first.deadline) / 1e9
                self._began = first.deadline / 1e9
                self._samples = Cycles(self.signals, rate, time.time() - late - self.epoch)
            elif self._start == "epoch":
                self._begin(self.elapsed)
            async with self._port as address:
                ready(address)
                while True:
                    await (anext(ticker) if self._rows is None else ticker.until(self._next_look(self._rows)))
                    self.advance()
                    if self._outage:
                        self._port.interrupt(self._outage)
                        self._outage = 0.0

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = EmulatedClient(writer, self.version, self.start, self.stop)
        self.clients.add(client)
        try:
            await client.converse(reader)
        finally:
            self._lose(client)

    def _next_look(self, rows: Rows) -> int:
        """The next row's time, or an earlier check for faults, ns of the monotonic clock."""
        now = time.monotonic()
        row = math.inf if self._samples is None else self._began + rows.next(now - self._began)
        return round(min(row, now + 1 / LOOKS) * 1e9)

    def _begin(self, elapsed: float) -> None:
        """Start the recording as of ``elapsed`` s ago."""
        self._began = time.monotonic() - elapsed
        self._samples = self._rows

    def start(self, client: EmulatedClient) -> None:
        """Send a client its packages from now on; it takes over the state of a listener that lost its connection."""
        if begins := self._samples is None:
            self._begin(0.0)
        assert self._samples is not None
        now = time.monotonic()  # one time for both calls of advance, or a row due in between is not counted
        self.advance(now)
        stride = decimation(self._samples.rate, client.rate) if self._samples.rate else 1
        listener = None if client.compares else next((p for p in self._listeners if p.lost), None)
        made = self._made(client.encoder, stride)
        if listener is None:
            listener = Listener(0, stride, client, made)
            self._listeners.append(listener)
        if listener.client is not None:
            listener.client.listener = None
        listener.client, listener.stride, listener.made = client, stride, made
        start = 0 if begins else max(self._samples.due(now - self._began), listener.next)
        listener.next = -(-start // stride) * stride
        client.listener = listener
        self.advance(now)

    def stop(self, client: EmulatedClient) -> None:
        """Send a client no more packages."""
        self.advance()
        if client.listener is not None:
            self._listeners.remove(client.listener)
            client.listener = None

    def _lose(self, client: EmulatedClient) -> None:
        """Remove a client whose connection is closed; packages that its listener misses from now on are counted."""
        self.clients.discard(client)
        listener, client.listener = client.listener, None
        if listener is not None:
            listener.client = None
            if client.compares:
                self._listeners.remove(listener)

    def _reboot(self, seconds: float) -> None:
        """Go down for ``seconds`` s; timestamps then start from 0, and lost packages are no longer counted."""
        self.advance()
        self.tally["reboot"] += 1
        self._leave_all(seconds)
        for listener in self._listeners:
            if listener.client is not None:
                listener.client.listener = None
        self._listeners.clear()
        if self._samples is not None:
            elapsed = time.monotonic() - self._began + seconds
            at = np.array([self._samples.due(elapsed)])
            self._shift = -float(self._samples.stamps(at)[0])

    def _leave_all(self, seconds: float) -> None:
        for client in self.clients:
            client.end()
        self._outage = seconds

    def advance(self, now: float | None = None) -> None:
        """Do what is due: end holds, strike one-shot faults, make and send packages."""
        now = time.monotonic() if now is None else now
        for client in list(self.clients):
            released = client.release(now)
            self.tally["sent"] += 0 if client.compares else released
        if self._samples is None:
            return
        if any(p.client is not None for p in self._listeners):
            self._strike_once(now)
        due = self._samples.due(now - self._began)
        if self._samples.end is not None:
            due = min(due, self._samples.end)
        for listener in list(self._listeners):
            self._serve(listener, due, now)

    def _strike_once(self, now: float) -> None:
        if fault := self.injector.once("clock_jump"):
            self._shift += fault.seconds
            self._forget()
        if fault := self.injector.once("stall"):
            for client in self.clients:
                client.hold(now + fault.seconds)
        if fault := self.injector.once("disconnect"):
            self._leave_all(fault.seconds)

    def _serve(self, listener: Listener, due: int, now: float) -> None:
        """Make and send one listener's due packages in one write; no fault strikes a client that compares clocks."""
        ready: list[bytes] = []
        client = listener.client
        apart = client is not None and client.compares
        tally, strikes = (Counter[str](), Injector().strikes) if apart else (self.tally, self.injector.strikes)
        while listener.next < due and client is not None and client.listening:
            number = listener.next
            listener.next += listener.stride
            tally["made"] += 1
            if strikes("loss", now):
                continue
            made, row = listener.made.at(number // listener.stride)
            package = made[row * client.encoder.size :][: client.encoder.size]
            if fault := strikes("delay", now):
                self._send(client, ready)
                client.hold(now + fault.seconds)
            if strikes("half_frame", now):
                self._send(client, ready)
                client.put(package[: len(package) // 2])
                client.end()
            elif strikes("garbage", now):
                self._send(client, ready)
                client.put(self._garbage(package))
                client.listening = False
            else:
                ready.append(package)
        unheard = max(0, -(-(due - listener.next) // listener.stride))
        tally["made"] += unheard
        listener.next += unheard * listener.stride
        if client is not None:
            self._send(client, ready)

    def _send(self, client: EmulatedClient, packages: list[bytes]) -> None:
        written = client.put(b"".join(packages), len(packages))
        if not client.compares:
            self.tally["sent"] += written
        packages.clear()
        if client.unread > UNREAD * client.rate * client.encoder.size:
            self.tally["unread"] += 1
            client.abort()

    def _made(self, encoder: Encoder, stride: int) -> Blocks[bytes]:
        """Every ``stride``-th package, one after the other; those of ``AHEAD`` s are encoded at once."""
        samples = self._samples
        assert samples is not None

        def encoded(t: Float) -> bytes:
            numbers = t.astype(np.int64)
            if samples.end is not None:
                numbers = numbers[numbers < samples.end]
            return encoder.encode(samples.stamps(numbers) + self._shift, samples.columns(numbers))

        return Blocks(encoded, stride, max(1, math.ceil(AHEAD * (samples.rate or 125.0) / stride)))

    def _forget(self) -> None:
        """Discard the packages made ahead."""
        for listener in self._listeners:
            listener.made.forget()

    def _garbage(self, package: bytes) -> bytes:
        """Bytes that are no valid RTDE: an unknown kind, a size too short or too long, or another recipe."""
        forms = (
            b"\x00\x40\x7f" + self.injector.random_bytes(1, 60),
            b"\x00\x02U" + self.injector.random_bytes(1, 60),
            (len(package) + 8).to_bytes(2, "big") + package[2:] + bytes(8),
            package[:3] + b"\xff" + package[4:],
        )
        return forms[self.injector.below(len(forms))]


def _version(text: str) -> ControllerVersion:
    if not re.fullmatch(r"([3-9]|1\d)(\.\d{1,9}){1,3}", text):
        raise ValueError(f"polyscope is a version like 5.12.0, not {text!r}")
    major, minor, bugfix, build = (*map(int, text.split(".")), 0, 0)[:4]
    return ControllerVersion(major, minor, bugfix, build)
