"""A process with the sink and a cell, until it is killed: ``python -m … BROKER FORMAT [FOLDER]``."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from tests.daemon.sinks.mqtt.cell import Cell, serving, sink_of


async def main(broker: str, format_: str, folder: str) -> None:
    cell = Cell(Path(folder) if folder else None)
    sink = sink_of(cell, broker, format=format_)
    async with serving(sink, cell):
        while True:
            if folder and sink._outbox.serving:
                sink.offer(cell.frames(1))
            await asyncio.sleep(0.03)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
