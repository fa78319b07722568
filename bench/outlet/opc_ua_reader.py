"""A client that subscribes to all variables: ``python -m outlet.opc_ua_reader URL``; it counts what comes.

An order ``{}`` begins to count; ``{"expected": N}`` is answered with what came, once N values did or no more come.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sys
import time
from typing import Any

from asyncua import Client, ua

from outlet.children import say
from outlet.rows import CELL, LAYOUT, SITE

SPACE = f"urn:cellwatt:{SITE}:{CELL}"
PERIOD = 20.0
"""ms between two messages of the server."""
QUEUE = 5000
"""Values of a variable that may wait in the server for the next message."""
PATIENCE = 30.0
"""s for the variables to be there."""
QUIET = 2.0
"""s without a value after which no more come."""


class Count:
    """Values so far, and the monotonic time of the first and the last, ns."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Count from now on."""
        self.count, self.first, self.last = 0, 0, 0

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """Take one value; the library calls this."""
        self.last = time.monotonic_ns()
        self.first = self.first or self.last
        self.count += value is not None

    def status_change_notification(self, status: Any) -> None:
        """Take word of the subscription; the library calls this."""

    async def told(self, expected: float) -> dict[str, int]:
        """What came, once there is no more to come."""
        before, since = self.count, time.monotonic()
        while self.count < expected and time.monotonic() - since < QUIET:
            await asyncio.sleep(0.002)
            if self.count != before:
                before, since = self.count, time.monotonic()
        return {"count": self.count, "first": self.first, "last": self.last}


async def _nodes(client: Client) -> list[Any]:
    """The variables of all channels, once the server has them and their first values."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            space = await client.get_namespace_index(SPACE)
            nodes = [client.get_node(ua.NodeId(channel.name, space)) for channel in LAYOUT.channels]
            await client.read_values(nodes)
        except (ua.UaError, ValueError):
            if time.monotonic() > end:
                raise
            await asyncio.sleep(0.05)
        else:
            return nodes


async def read(url: str) -> None:
    """Serve orders until the input ends."""
    count = Count()
    async with Client(url) as client:
        nodes = await _nodes(client)
        subscription = await client.create_subscription(PERIOD, count)
        await subscription.subscribe_data_change(nodes, queuesize=QUEUE)
        await count.told(len(nodes))  # the values that are there already
        say("ready")
        while line := await asyncio.to_thread(sys.stdin.readline):
            order = json.loads(line)
            if "expected" in order:
                say(await count.told(order["expected"]))
            else:
                count.begin()
                say("begun")


if __name__ == "__main__":
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # a server that is late is what is measured
    asyncio.run(read(sys.argv[1]))
