"""InfluxDB as any outlet that forwards: servers that are away, silent, lying or refusing, and restarts."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from cellwatt.outlets.historian.outlet import FILE, HistorianOutlet
from cellwatt.testing import OutletConformance, OutletRig
from tests.daemon.outlets.historian.parsing import parse
from tests.daemon.outlets.historian.server import Fake


class Server:
    def __init__(self, server: Fake) -> None:
        self.server, self.address, self.refuse = server, server.url.removeprefix("http://"), False
        server.refuses = lambda _: self.refuse

    @property
    def got(self) -> list[int]:
        return [] if self.refuse else [parse(line).time for lines in self.server.batches for line in lines]


@asynccontextmanager
async def server() -> AsyncIterator[Server]:
    async with Fake().open() as found:
        yield Server(found)


def at(address: str) -> dict[str, object]:
    told = {"url": f"http://{address}", "database": "plant", "rate": "10 Hz", "every": "20 ms", "timeout": "500 ms"}
    return {"influx": told}


class TestConformance(OutletConformance):
    rigs = (OutletRig(HistorianOutlet, {}, server, at, position=FILE),)
