"""A power analyzer's SCPI port: TCP or a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
import pty
import time
import tty
from collections import Counter
from collections.abc import Callable, Mapping
from typing import ClassVar

from cellwatt.emulation import Emulator, Fault, Signals
from cellwatt.emulation.faults import FaultKind
from cellwatt_drivers.scpi_analyzer.emulated_analyzer import EmulatedAnalyzer, known_functions
from cellwatt_drivers.scpi_analyzer.emulated_makes import EmulatedLmg670, EmulatedWt310
from cellwatt_drivers.scpi_analyzer.wire import PORT

_MAKES: Mapping[str, tuple[type[EmulatedAnalyzer], str]] = {
    "hmc8015": (EmulatedAnalyzer, "Rohde&Schwarz,HMC8015,000000001,HW10000000,SW1.403"),
    "wt300": (EmulatedWt310, "YOKOGAWA,WT310E,C2XX00001V,F1.03"),
    "lmg600": (EmulatedLmg670, "ZES ZIMMER Electronic Systems GmbH,LMG670,00000001,7.134"),
}
"""By the name of the driver's ``model``: the instrument, and its answer to ``*IDN?``."""


class ScpiAnalyzerEmulator(Emulator):
    """One analyzer on the mains of ``supply.power``, ``supply.voltage`` and ``supply.current``.

    Listens on 127.0.0.1:5025 unless told otherwise; ``pty`` makes it a serial port. Options: ``model``
    (``hmc8015``, ``wt300``: a WT310E, ``lmg600``: an LMG670), ``idn`` (the answer to ``*IDN?``), ``overload``
    (functions, comma-separated, whose input is too large from the start).

    Faults on measured values (answers to ``DATA?``, ``VAL?`` or ``INIM``): ``loss`` (not sent), ``half_frame``
    (cut, without its end), ``delay`` (late by ``seconds``), ``garbage`` (a line of random bytes ahead of it). At the
    next line received, ``stall`` leaves the asker waiting for ``seconds``; ``disconnect`` closes the port for
    ``seconds``, on a pseudo-terminal it lets all bytes be lost. ``made`` counts queries for data, ``sent`` whole
    answers to them.
    """

    title: ClassVar[str] = "Power analyzer (SCPI: R&S HMC8015, Yokogawa WT310E, ZES LMG670)"
    faults: ClassVar[tuple[FaultKind, ...]] = ("delay", "loss", "garbage", "half_frame", "stall", "disconnect")

    def __init__(
        self,
        signals: Signals,
        address: str,
        *,
        epoch: float | None = None,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(signals, address or f"127.0.0.1:{PORT}", epoch=epoch, seed=seed, options=options)
        left = dict(self.options)
        model = left.pop("model", "hmc8015")
        if model not in _MAKES:
            raise ValueError(f"model {model!r} is not one of {', '.join(_MAKES)}")
        make, identification = _MAKES[model]
        self.analyzer = make(signals, left.pop("idn", identification))
        overload = [name for name in left.pop("overload", "").split(",") if name]
        self.analyzer.overload = known_functions(overload)
        if unknown := set(overload) - self.analyzer.overload:
            raise ValueError(f"overload names functions it does not measure: {', '.join(sorted(unknown))}")
        if left:
            raise ValueError(f"unknown options: {', '.join(left)}")
        self.lines: Counter[str] = Counter()
        self._counts = Counter(made=0, sent=0)
        self._outages: asyncio.Queue[Fault] = asyncio.Queue()
        self._talking: set[asyncio.Task[None]] = set()

    @property
    def counts(self) -> Mapping[str, int]:
        """See ``Emulator.counts``."""
        return {**self._counts, **self.injector.counts}

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        if self.address == "pty":
            await self._serve_pty(ready)
        else:
            await self._serve_tcp(ready)

    async def _serve_tcp(self, ready: Callable[[str], None]) -> None:
        host, _, port = self.address.rpartition(":")
        server = await asyncio.start_server(self._accept, host, int(port))
        bound: tuple[str, int] = server.sockets[0].getsockname()[:2]
        ready(f"{bound[0]}:{bound[1]}")
        try:
            while True:
                outage = await self._outages.get()
                server.close()
                await self._hang_up()
                await asyncio.sleep(outage.seconds)
                server = await asyncio.start_server(self._accept, *bound)
        finally:
            server.close()
            await self._hang_up()

    async def _hang_up(self) -> None:
        for task in self._talking:
            task.cancel()
        await asyncio.gather(*self._talking, return_exceptions=True)
        await asyncio.sleep(0)  # closed transports let go of their sockets at the loop's next turn

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._talking.add(task)
        try:
            await self._converse(reader, writer.write)
        except (ConnectionError, asyncio.CancelledError):
            pass  # the client is gone, or hung up on: nobody awaits this task, and Python 3.11 would log it
        finally:
            self._talking.discard(task)
            writer.close()

    async def _serve_pty(self, ready: Callable[[str], None]) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave)
        reader = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        transport, _ = await loop.connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(master, "rb", 0)
        )
        ready(os.ttyname(slave))
        try:
            while True:
                talk = asyncio.create_task(self._converse(reader, lambda data: os.write(master, data)))
                try:
                    outage = await self._outages.get()
                finally:
                    talk.cancel()
                await self._lose_bytes(reader, outage.seconds)
        finally:
            transport.close()
            os.close(slave)

    async def _lose_bytes(self, reader: asyncio.StreamReader, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                while True:
                    await reader.read(4096)
        except TimeoutError:
            pass  # the cable is back

    async def _converse(self, reader: asyncio.StreamReader, write: Callable[[bytes], object]) -> None:
        while data := await reader.readline():
            if outage := self.injector.once("disconnect"):
                self._outages.put_nowait(outage)
                await asyncio.sleep(outage.seconds)  # ended from outside before that
                return
            if stall := self.injector.once("stall"):
                await asyncio.sleep(stall.seconds)
            line = data.decode("ascii", "replace").strip()
            self.lines[line] += 1
            answer = self.analyzer.execute(line, time.time() - self.epoch)
            if answer is None:
                continue
            if self.analyzer.data_query in line.upper():
                await self._send_data(answer.encode() + b"\n", write)
            else:
                write(answer.encode() + b"\n")

    async def _send_data(self, frame: bytes, write: Callable[[bytes], object]) -> None:
        self._counts["made"] += 1
        now = time.monotonic()
        strikes = self.injector.strikes
        if strikes("loss", now):
            return
        if strikes("half_frame", now):
            write(frame[: 1 + self.injector.below(len(frame) - 2)])
            return
        if late := strikes("delay", now):
            await asyncio.sleep(late.seconds)
        if strikes("garbage", now):
            write(self.injector.random_bytes(1, 32).replace(b"\n", b"\0") + b"\n")
        write(frame)
        self._counts["sent"] += 1
