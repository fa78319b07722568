"""A meter and the broker that it publishes to, in one."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import numpy as np

from cellwatt.emulation import Emulator, Options, TcpPort
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
    usual_address = "127.0.0.1:1883"
    faults = ("loss", "half_frame", "garbage", "delay", "stall", "disconnect")

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        self._topic = options.text("topic", "shellypro3em/status/em:0")
        self._rate = options.number("rate", 2.0)
        self._clients: set[Client] = set()
        self._port = TcpPort(self, self._serve)

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        async with self._port as address, Ticker(self._rate) as ticker:
            ready(address)
            async for _ in ticker:
                if outage := self.injector.once("disconnect"):
                    self._port.interrupt(outage.seconds)
                if stall := self.injector.once("stall"):
                    await asyncio.sleep(stall.seconds)
                await self._publish()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = Client(writer)
        self._clients.add(client)
        try:
            await client.serve(reader)
        finally:
            self._clients.discard(client)

    async def _publish(self) -> None:
        listeners = [c for c in self._clients if self._topic in c.topics]
        if not listeners:
            return
        self.tally["made"] += 1
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
        self.tally["sent"] += whole

    def _measure(self) -> dict[str, float]:
        now = self.signals.at(np.array([time.time() - self.epoch]))
        power, current, voltage = (float(now[f"supply.{name}"][0]) for name in ("power", "current", "voltage"))
        return {
            "total_act_power": power,
            "total_aprt_power": abs(current * voltage),
            "total_current": current,
            **{f"{phase}_voltage": voltage for phase in "abc"},
        }
