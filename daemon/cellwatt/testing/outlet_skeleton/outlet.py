"""Skeleton webhook: converts rows to messages, and sends them in blocks."""

from __future__ import annotations

import asyncio
import http.client
import json
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar
from urllib.parse import urlsplit

from pydantic import Field, field_validator
from pydantic_core import to_jsonable_python

from cellwatt import Alarm, Energy, ForwardOutlet, ForwardSettings, NotNowError, Row, Task
from cellwatt.host import in_the_clear, web_address
from cellwatt.quantity import Seconds

Message = dict[str, Any]
TAKEN, REFUSED = range(200, 300), (400, 422)


class SkeletonSettings(ForwardSettings):
    """Blocks of rows, alarms, tasks and energies as JSON by HTTP POST."""

    url: str
    """Where to post them, like ``https://receiver.example/rows``; http is allowed for this PC only."""
    timeout: Seconds = Field(default=5.0, gt=0)
    """Longest wait for an answer."""

    @field_validator("url")
    @classmethod
    def _address(cls, url: str) -> str:
        web_address(url, "https://receiver.example/rows")
        if in_the_clear(url):
            raise ValueError("http is for this PC alone: use https")
        return url


class SkeletonOutlet(ForwardOutlet[SkeletonSettings, Message]):
    """Posts blocks of messages; ``ForwardOutlet`` handles order, repetition, missed rows and the account."""

    Settings: ClassVar[type[SkeletonSettings]] = SkeletonSettings
    title = "Skeleton: blocks of rows by HTTP POST"

    @property
    def place(self) -> str:
        """The receiver; rows owed to one receiver are not owed to another."""
        return self.settings.url

    def row(self, row: Row, units: Mapping[str, str]) -> Message | None:
        """One row as JSON; by its time, UTC ns, a receiver recognizes repeated rows."""
        return {"time": row.time, "values": row.values, "units": {name: units[name] for name in row.values}}

    def result(self, result: Alarm | Task | Energy) -> Message | None:
        """An alarm, task or energy as JSON."""
        content: Message = to_jsonable_python(result, inf_nan_mode="null", fallback=str)
        return {"kind": type(result).__name__.lower(), **content}

    async def send(self, messages: Sequence[Message]) -> Mapping[str, int]:
        """Post one block; return counts of permanently refused messages. Raises ``NotNowError`` to send it again."""
        try:
            status, reason = await asyncio.to_thread(self._post, json.dumps(messages).encode())
        except (OSError, http.client.HTTPException) as error:
            raise NotNowError(f"{self.settings.url}: {error or type(error).__name__}") from None
        if status in REFUSED:
            return {"refused": len(messages)}
        if status not in TAKEN:
            raise NotNowError(f"{self.settings.url}: {status} {reason}")
        return {}

    def _post(self, body: bytes) -> tuple[int, str]:
        parts = urlsplit(self.settings.url)
        kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        connection = kind(parts.hostname or "", parts.port, timeout=self.settings.timeout)
        try:
            path = f"{parts.path or '/'}{'?' + parts.query if parts.query else ''}"
            connection.request("POST", path, body, {"Content-Type": "application/json"})
            answer = connection.getresponse()
            answer.read(64_000)
            return answer.status, answer.reason
        finally:
            connection.close()
