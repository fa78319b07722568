"""The outlet over MQTT beside aiomqtt alone: rows a second, loss, and how late the loop is when the broker hangs."""

from __future__ import annotations

import asyncio
import signal
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import aiomqtt

from cellwatt import Frames
from cellwatt.outlets.mqtt.outlet import MqttOutlet
from cellwatt.outlets.mqtt.settings import MqttSettings
from outlet.children import child
from outlet.figures import Figures
from outlet.loop import served, ticks, until
from outlet.mqtt_plain import Give, payloads, plain
from outlet.mqtt_reader import END
from outlet.rows import BLOCK, LAYOUT, RATE, View, frames
from outlet.servers import MOSQUITTO, Mosquitto, mosquitto
from outlet.turns import in_turn


def measure(seconds: float, repeats: int) -> Figures:
    """Figures of the outlet over MQTT."""
    if MOSQUITTO is None:
        return {"not measured": "mosquitto is not installed"}
    with tempfile.TemporaryDirectory() as folder, mosquitto(Path(folder)) as broker:
        return {**_rows(broker, seconds, repeats), **_lateness(broker, seconds)}


def made(port: int, qos: int) -> MqttOutlet:
    """The outlet to a broker of this host."""
    told = {"broker": f"mqtt://127.0.0.1:{port}", "rate": f"{RATE:g} Hz", "qos": {"frame": qos}, "queue": 4096}
    view: Any = View()
    return MqttOutlet("mqtt", MqttSettings.model_validate(told), view)


def _rows(broker: Mosquitto, seconds: float, repeats: int) -> Figures:
    givers = {"cellwatt": flood, "plain_one_by_one": plain(1), "plain_64_at_a_time": plain(64)}
    ways = {
        f"{name}_qos_{qos}": partial(through, broker.port, give, qos, seconds)
        for qos in (1, 0)
        for name, give in givers.items()
    }
    return {"payload_bytes": len(payloads(1)[0]), **in_turn(ways, repeats)}


def through(port: int, give: Give, qos: int, seconds: float) -> dict[str, float]:
    """Rows a second at a subscriber, and the share that it did not get."""
    with child("mqtt_reader", str(port)) as reader:
        reader.answer()
        given = asyncio.run(_given(port, give, qos, seconds))
        found = reader.answer()
    span = (found["last"] - found["first"]) / 1e9
    return {"rows_per_s": (found["count"] - 1) / span, "lost": 1 - found["count"] / given}


async def _given(port: int, give: Give, qos: int, seconds: float) -> int:
    given = await give(port, qos, seconds)
    async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.publish(END, b"", 1)
    return given


async def flood(port: int, qos: int, seconds: float) -> int:
    """Offer frames to the outlet, as fast as its queue takes them; give how many."""
    outlet = made(port, qos)
    blocks = [frames(BLOCK * i, BLOCK) for i in range(40)]

    async def work() -> int:
        sequence = 0
        await until(lambda: outlet._outbox.serving)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            block = blocks[(sequence // BLOCK) % len(blocks)]
            outlet.offer(Frames(LAYOUT, sequence, block.time, block.values, block.quality, block.bound))
            sequence += BLOCK
            await until(lambda: len(outlet._outbox.rows) < 200, 0.0)
        await until(lambda: outlet.account.counters["rows sent"] == sequence)
        return sequence

    return await served(outlet, work)


def _lateness(broker: Mosquitto, seconds: float) -> Figures:
    return {
        "lateness_without": asyncio.run(ticks(seconds, lambda number: None)),
        "lateness_with_broker": asyncio.run(_late(broker, None, seconds)),
        "lateness_broker_hangs": asyncio.run(_late(broker, signal.SIGSTOP, seconds)),
    }


async def _late(broker: Mosquitto, how: signal.Signals | None, seconds: float) -> dict[str, float]:
    outlet = made(broker.port, 1)
    given = 0

    def each(number: int) -> None:
        nonlocal given
        if number // 20 > given:
            given = number // 20
            outlet.offer(frames(given, 1))

    async def work() -> dict[str, float]:
        await until(lambda: outlet._outbox.serving)
        await asyncio.sleep(0.2)
        if how is not None:
            broker.signal(how)
        try:
            return await ticks(seconds, each)
        finally:
            broker.signal(signal.SIGCONT)

    return await served(outlet, work)
