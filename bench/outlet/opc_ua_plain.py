"""asyncua alone, with as many variables: ``python -m outlet.opc_ua_plain``; it says its address first.

An order ``[rate, count]`` has it write so many rows at a rate, or for a rate of 0 without a pause; it answers then.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sys
from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

from asyncua import Server, ua

from cellwatt.ticker import Ticker
from outlet.children import free_port, say
from outlet.opc_ua_reader import SPACE
from outlet.rows import CELL, LAYOUT, START, frames

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


async def due(rate: float, count: int) -> AsyncIterator[None]:
    """So many turns at a rate, or for a rate of 0 without a pause; the loop has a turn of its own after each."""
    if not rate:
        for _ in range(count):
            yield
            await asyncio.sleep(0)
        return
    async with Ticker(rate) as ticker:
        async for tick in ticker:
            for _ in range(min(tick.merged + 1, count)):
                yield
                await asyncio.sleep(0)
            count -= tick.merged + 1
            if count <= 0:
                break


class Plain:
    """A server whose values are written as its documentation says where it is to be fast."""

    def __init__(self) -> None:
        self._server = Server()
        self._nodes: list[Any] = []
        self._given = 0

    async def open(self) -> str:
        """Make the variables, and listen; return the address."""
        url = f"opc.tcp://127.0.0.1:{free_port()}/plain"
        await self._server.init()
        self._server.set_endpoint(url)
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await self._server.register_namespace(SPACE)
        folder = await self._server.nodes.objects.add_folder(space, CELL)
        for channel in LAYOUT.channels:
            node_id = ua.NodeId(channel.name, space)
            self._nodes.append(await folder.add_variable(node_id, ua.QualifiedName(channel.name, space), 0.0))
        await self._server.start()
        return url

    async def close(self) -> None:
        """Hang up."""
        await self._server.stop()

    async def write(self, rate: float, count: int) -> None:
        """Write so many rows."""
        async for _ in due(rate, count):
            await self._row(self._given)
            self._given += 1

    async def _row(self, number: int) -> None:
        block = frames(number, 1)
        moment = _EPOCH + timedelta(microseconds=(START + number * LAYOUT.step) // 1000)
        for node, value in zip(self._nodes, block.values[0].tolist(), strict=True):
            told = ua.DataValue(
                ua.Variant(value, ua.VariantType.Double), SourceTimestamp=moment, ServerTimestamp=datetime.now(UTC)
            )
            await self._server.write_attribute_value(node.nodeid, told)


async def serve() -> None:
    """Serve, and write as ordered, until the input ends."""
    plain = Plain()
    say(await plain.open())
    try:
        while line := await asyncio.to_thread(sys.stdin.readline):
            await plain.write(*json.loads(line))
            say("written")
    finally:
        await plain.close()


if __name__ == "__main__":
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    asyncio.run(serve())
