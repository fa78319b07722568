"""A subscriber that counts rows: ``python -m outlet.mqtt_reader PORT``; it says what came once the end was told."""

from __future__ import annotations

import asyncio
import sys
import time

import aiomqtt

from outlet.children import say
from outlet.rows import CELL, SITE

ROOT = f"cellwatt/{SITE}/{CELL}"
END = f"{ROOT}/end"


async def count(port: int) -> dict[str, int]:
    """Rows until the end, and the monotonic time of the first and the last, ns."""
    rows, first, last = 0, 0, 0
    async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.subscribe(f"{ROOT}/#", 1)
        say("ready")
        async for message in client.messages:
            topic = str(message.topic)
            if topic == END:
                break
            if topic == f"{ROOT}/frame":
                last = time.monotonic_ns()
                first = first or last
                rows += 1
    return {"count": rows, "first": first, "last": last}


if __name__ == "__main__":
    say(asyncio.run(count(int(sys.argv[1]))))
