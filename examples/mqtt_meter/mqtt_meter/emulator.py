"""A meter and the broker that it publishes to, in one."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from cellwatt.emulation import Emulator, Signals
from cellwatt.ticker import Ticker
from mqtt_meter import payload
from mqtt_meter.broker import Client, publication


class MqttMeterEmulator(Emulator):
    """Publishes ``supply.power``, ``.current`` and ``.voltage`` of its signals; listens on TCP 1883.

    Options: ``topic`` (``shellypro3em/status/em:0``), ``rate`` (Hz, ``2``).

    Faults strike messages: ``loss`` (not published), ``half_frame`` (its JSON is cut off), ``garbage`` (random bytes
    in its place), ``delay`` (late by ``seconds``, and all behind it). ``stall``: nothing is published for
    ``seconds``; ``disconnect``: the broker is gone for ``seconds``. ``made`` counts messages made while somebody
    had subscribed, ``sent`` whole ones sent.
    """

    title = "Meter that publishes over MQTT"
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
        super().__init__(signals, address or "127.0.0.1:1883", epoch=epoch, seed=seed, options=options)
        left = dict(self.options)
        self._topic = left.pop("topic", "shellypro3em/status/em:0")
        self._rate = float(left.pop("rate", "2"))
        if left:
            raise ValueError(f"{self.title} has the options topic and rate, not {', '.join(left)}")
        self._counts = Counter(made=0, sent=0)
        self._clients: set[Client] = set()
        self._serving: set[asyncio.Task[None]] = set()

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
            async with Ticker(self._rate) as ticker:
                async for _ in ticker:
                    if outage := self.injector.once("disconnect"):
                        server.close()
                        await self._hang_up()
                        await asyncio.sleep(outage.seconds)
                        server = await asyncio.start_server(self._accept, host, port)
                    if stall := self.injector.once("stall"):
                        await asyncio.sleep(stall.seconds)
                    await self._publish()
        finally:
            server.close()
            await self._hang_up()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task, client = asyncio.current_task(), Client(writer)
        assert task is not None
        self._serving.add(task)
        self._clients.add(client)
        try:
            await client.serve(reader)
        except (OSError, asyncio.IncompleteReadError, asyncio.CancelledError):
            pass  # the client is gone, or hung up on: nobody awaits this task
        finally:
            self._serving.discard(task)
            self._clients.discard(client)
            writer.close()

    async def _hang_up(self) -> None:
        for task in self._serving:
            task.cancel()
        await asyncio.gather(*self._serving, return_exceptions=True)
        await asyncio.sleep(0)  # closed transports let go of their sockets at the loop's next turn

    async def _publish(self) -> None:
        listeners = [c for c in self._clients if self._topic in c.topics]
        if not listeners:
            return
        self._counts["made"] += 1
        message = payload.build(self._measure())
        strikes, now, whole = self.injector.strikes, time.monotonic(), True
        if strikes("loss", now):
            return
        if strikes("half_frame", now):
            message, whole = message[: 1 + self.injector.below(len(message) - 2)], False
        elif strikes("garbage", now):
            message, whole = self.injector.random_bytes(1, 40), False
        if late := strikes("delay", now):
            await asyncio.sleep(late.seconds)
        for client in listeners:
            client.writer.write(publication(self._topic, message))
        self._counts["sent"] += whole

    def _measure(self) -> dict[str, float]:
        now = self.signals.at(np.array([time.time() - self.epoch]))
        power, current, voltage = (float(now[f"supply.{name}"][0]) for name in ("power", "current", "voltage"))
        return {
            "total_act_power": power,
            "total_aprt_power": abs(current * voltage),
            "total_current": current,
            **{f"{phase}_voltage": voltage for phase in "abc"},
        }
