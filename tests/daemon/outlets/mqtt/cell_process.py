"""A process with the outlet and a cell, until it is killed: ``python -m … BROKER FORMAT [FOLDER]``."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from tests.daemon.outlets.mqtt.cell import Cell, outlet_of, serving


async def main(broker: str, format_: str, folder: str) -> None:
    cell = Cell(Path(folder) if folder else None)
    outlet = outlet_of(cell, broker, format=format_)
    async with serving(outlet, cell):
        while True:
            if folder and outlet._outbox.serving:
                outlet.offer(cell.frames(1))
            await asyncio.sleep(0.03)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
