"""The meter's side of the wire."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from cellwatt.emulation import Emulator, Signals
from cellwatt.testing.skeleton import wire


class SkeletonEmulator(Emulator):
    """A meter on ``supply.voltage``, ``.current`` and ``.power`` of its signals; listens on TCP.

    Faults on answers to ``READ?``: ``loss`` (not sent), ``half_frame`` (cut off), ``garbage`` (random bytes in its
    place), ``delay`` (late by ``seconds``). At the next question ``stall`` waits for ``seconds``; ``disconnect``
    closes the port for ``seconds``. ``made`` counts questions for a sample, ``sent`` whole answers to them.
    """

    title = "Skeleton meter"
    faults = ("loss", "half_frame", "garbage", "delay", "stall", "disconnect")

    def __init__(
        self,
        signals: Signals,
        address: str,
        *,
        epoch: float | None = None,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(signals, address or f"127.0.0.1:{wire.PORT}", epoch=epoch, seed=seed, options=options)
        if self.options:
            raise ValueError(f"{self.title} has no options, found {', '.join(self.options)}")
        self._counts = Counter(made=0, sent=0)
        self._outages: asyncio.Queue[float] = asyncio.Queue()
        self._talking: set[asyncio.Task[None]] = set()

    @property
    def counts(self) -> Mapping[str, int]:
        """See ``Emulator.counts``."""
        return {**self._counts, **self.injector.counts}

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        host, _, port = self.address.rpartition(":")
        server = await asyncio.start_server(self._accept, host, int(port))
        host, port = server.sockets[0].getsockname()[:2]
        ready(f"{host}:{port}")
        try:
            while True:
                seconds = await self._outages.get()
                server.close()
                await self._hang_up()
                await asyncio.sleep(seconds)
                server = await asyncio.start_server(self._accept, host, port)
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
            while question := await reader.readline():
                await self._answer(question, writer)
        except (ConnectionError, asyncio.CancelledError):
            pass  # the client is gone, or hung up on: nobody awaits this task
        finally:
            self._talking.discard(task)
            writer.close()

    async def _answer(self, question: bytes, writer: asyncio.StreamWriter) -> None:
        if outage := self.injector.once("disconnect"):
            self._outages.put_nowait(outage.seconds)
            await asyncio.Event().wait()  # until hung up on
        if stall := self.injector.once("stall"):
            await asyncio.sleep(stall.seconds)
        if question == wire.WHO:
            writer.write(b"METER,0001,1.0\n")
        elif question == wire.READ:
            await self._send(wire.format_sample(self._sample()), writer)

    async def _send(self, answer: bytes, writer: asyncio.StreamWriter) -> None:
        self._counts["made"] += 1
        strikes, now = self.injector.strikes, time.monotonic()
        if strikes("loss", now):
            return
        if strikes("half_frame", now):
            writer.write(answer[: 1 + self.injector.below(len(answer) - 2)])
            return
        if strikes("garbage", now):
            writer.write(self.injector.random_bytes(1, 32).replace(b"\n", b"\0") + b"\n")
            return
        if late := strikes("delay", now):
            await asyncio.sleep(late.seconds)
        writer.write(answer)
        self._counts["sent"] += 1

    def _sample(self) -> wire.Sample:
        now = self.signals.at(np.array([time.time() - self.epoch]))
        return wire.Sample(*(float(now[f"supply.{name}"][0]) for name in ("voltage", "current", "power")))
