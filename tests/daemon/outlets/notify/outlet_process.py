"""Runs the outlet in a process that may be killed: ``FOLDER URL FIRST COUNT``.

Alarms below FIRST are those that were published before; the others, up to COUNT, come one by one.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from tests.daemon.outlets.notify.cell import View, alarm, outlet
from tests.daemon.outlets.zenoh.fake_cell import Journal


async def run(folder: Path, url: str, first: int, count: int) -> None:
    journal = Journal(*map(alarm, range(first)))
    to = {name: {"webhook": {"url": f"{url}/{name}", "secret": "a secret"}} for name in ("one", "two")}
    made = outlet(View(folder, journal=journal), to, queue=1000)
    async with asyncio.TaskGroup() as group:
        group.create_task(made.run())
        for number in range(first, count):
            journal.put(alarm(number))
            made.offer(alarm(number))
            await asyncio.sleep(0.01)


if __name__ == "__main__":
    asyncio.run(run(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])))
