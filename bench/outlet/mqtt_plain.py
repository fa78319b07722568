"""aiomqtt alone, with payloads that are there already."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable

import aiomqtt

from cellwatt import AlarmBook
from cellwatt.outlets.mqtt.message import Labels
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.selection import Picker
from outlet.mqtt_reader import ROOT
from outlet.rows import CELL, LAYOUT, RATE, SITE, frames

Give = Callable[[int, int, float], Awaitable[int]]
"""Sends rows to a port with a quality of service for some seconds; gives how many."""


def payloads(count: int) -> list[bytes]:
    """Payloads as the outlet makes them."""
    settings = MqttSettings(rate=RATE)
    format_, picker = PlainFormat(settings, SITE, CELL, AlarmBook()), Picker(settings, LAYOUT)
    format_.label(Labels(picker.units, dict.fromkeys(picker.units, "continuous")), 0)
    return [format_.row(row, False, 0)[0].payload for row in picker.rows(frames(0, count))]


def plain(at_a_time: int) -> Give:
    """Publishes so many messages at a time."""

    async def give(port: int, qos: int, seconds: float) -> int:
        made, given = payloads(1000), 0
        async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
            client.pending_calls_threshold = 1000
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                each = [client.publish(f"{ROOT}/frame", made[(given + i) % len(made)], qos) for i in range(at_a_time)]
                await asyncio.gather(*each)
                given += at_a_time
        return given

    return give
