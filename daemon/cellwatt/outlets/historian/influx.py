"""InfluxDB as a peer: rows and results as lines, sent until each is written or refused for good."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from cellwatt.account import Account
from cellwatt.errors import why
from cellwatt.outlet import CellView, Item
from cellwatt.outlets.aside import put_aside
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.forward import Forwarder, NotNowError
from cellwatt.outlets.historian.client import Client
from cellwatt.outlets.historian.line_protocol import result_line, row_line
from cellwatt.outlets.historian.settings import InfluxSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.selection import Row

log = logging.getLogger(__name__)

FILE: Final = "historian-influx.json"
REFUSED: Final = "historian-refused.txt"
"""File of the lines that the server will never take, with the reasons."""
LARGEST: Final = 16_000_000
"""Bytes of it."""
TRIES: Final = 64
"""Requests by which the bad lines of a batch are looked for; then what is left of it is refused as a whole."""


class Lines:
    """Lines of one database or bucket; those that it refuses are kept in ``folder``."""

    def __init__(self, client: Client, measurement: str, tags: Mapping[str, str], folder: Path | None) -> None:
        self.requests = 0
        self._client, self._folder = client, folder
        self._measurement, self._tags = measurement, tags

    def row(self, row: Row, units: Mapping[str, str]) -> str | None:
        """See ``Peer.row``."""
        return row_line(self._measurement, self._tags, row) or None

    def result(self, result: Archived) -> str | None:
        """See ``Peer.result``."""
        return result_line(self._measurement, self._tags, result) or None

    async def send(self, messages: Sequence[str]) -> Mapping[str, int]:
        """See ``Peer.send``; where the server refuses some lines, those are found by halves.

        A batch with a bad line is sent again in parts: a point that was written already is the same point.
        """
        parts, found = [list(messages)], Counter[str]()
        tries = 0
        while parts:
            part = parts.pop()
            outcome = await self._client.write(part)
            tries += 1
            match outcome.kind:
                case "written":
                    continue
                case "later":
                    raise NotNowError(f"{self._client.url}: {outcome.reason}", outcome.wait)
                case "refused" | "too large" if len(part) > 1 and tries < TRIES:
                    half = len(part) // 2
                    parts += [part[half:], part[:half]]
                case _:
                    await asyncio.to_thread(_refused, self._folder, part, outcome.reason)
                    found[outcome.kind] += len(part)
        return found


def _refused(folder: Path | None, lines: Sequence[str], reason: str) -> None:
    """Put lines aside, below the reason; without a folder the log alone tells. Blocks."""
    log.warning("influx: %d lines are refused for good: %s", len(lines), reason)
    if folder is not None:
        content = "\n".join((f"# {' '.join(reason.split())}", *lines, "")).encode()
        try:
            put_aside(folder / REFUSED, content, LARGEST, 0o644)
        except OSError as error:
            log.warning("influx: %s cannot be written: %s", folder / REFUSED, why(error))


class Influx:
    """One database or bucket of a cell. ``record`` is the folder of the record, ``None`` where there is none."""

    def __init__(self, settings: InfluxSettings, view: CellView, record: Path | None, account: Account) -> None:
        self._client = Client(settings)
        place = f"{settings.url} {settings.database or settings.bucket} {settings.org or ''}".strip()
        cursor = Cursor(None if record is None else record / FILE, account, place)
        peer = Lines(self._client, settings.measurement, {"site": view.site, "cell": view.cell}, record)
        self.forwarder: Forwarder[str] = Forwarder("influx", peer, settings, view.cell, record, cursor, account)

    def offer(self, item: Item) -> None:
        """Queue an item."""
        self.forwarder.offer(item)

    async def run(self) -> None:
        """Write until cancelled, then once more, and keep what is left to be filled in."""
        async with self._client:
            await self.forwarder.run()
