"""Sends lines until each is written or refused for good."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from cellwatt.account import Account
from cellwatt.outlets.historian import refused
from cellwatt.outlets.historian.client import Outcome

TRIES: Final = 64
"""Requests by which the bad lines of a batch are looked for; then what is left of it is refused as a whole."""


class Writes(Protocol):
    """Something that takes lines."""

    async def write(self, lines: Sequence[str]) -> Outcome:
        """Send lines; tell what became of them."""
        ...


@dataclass(frozen=True, slots=True)
class Sent:
    """Lines left over, and the reason and wait where the server takes nothing for now."""

    rest: Sequence[str] = ()
    later: Outcome | None = None


class Sender:
    """Sends by a client; counts written and refused lines in ``account``, keeps the latter in ``folder``."""

    def __init__(self, client: Writes, account: Account, folder: Path | None) -> None:
        self._client, self._account, self._folder = client, account, folder

    async def send(self, lines: Sequence[str]) -> Sent:
        """Send lines; where the server refuses some, those are found by halves.

        A batch with a bad line is sent again in parts: a point that was written already is the same point.
        """
        parts, tries = [list(lines)], 0
        while parts:
            part = parts.pop()
            outcome = await self._client.write(part)
            self._account.count("influx: requests")
            tries += 1
            match outcome.kind:
                case "written":
                    self._account.expect(len(part))
                    self._account.receive(len(part))
                case "later":
                    self._account.count("influx: requests to be repeated")
                    return Sent([line for p in (part, *reversed(parts)) for line in p], outcome)
                case "refused" | "too large" if len(part) > 1 and tries < TRIES:
                    half = len(part) // 2
                    parts += [part[half:], part[:half]]
                case _:
                    await asyncio.to_thread(refused.keep, self._folder, part, outcome.reason)
                    self._account.lose(len(part), f"influx: {outcome.kind}")
        return Sent()
