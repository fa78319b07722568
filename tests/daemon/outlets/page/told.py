"""A page that is told what stages really gave, over the wire of its process, and asked over HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from cellwatt.outlets.apart import wire
from cellwatt.outlets.zenoh.messages import parse_json
from cellwatt.results import Event, Result
from tests.daemon.outlets.page.cell import API, client, served

Ask = Callable[[str], Awaitable[Any]]


@asynccontextmanager
async def page_told(folder: Path, items: Iterable[Result | Event], reports: Path | None = None) -> AsyncIterator[Ask]:
    """Ask a page by the end of an address; it was told ``items``, and shows the folder ``reports``."""
    async with served(folder, reports=reports) as page, client() as browser:
        reader = asyncio.StreamReader()
        for item in items:
            reader.feed_data(wire.item(item))
        reader.feed_eof()
        while (got := await wire.receive(reader)) is not None:
            told = parse_json(got[1])
            page.feed.take_item(told["kind"], told["body"])

        async def ask(what: str) -> Any:
            async with browser.get(f"{page.url}{API}/{what}") as response:
                assert response.status == 200, await response.text()
                return await response.json()

        yield ask
