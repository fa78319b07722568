"""Orders to a process that a test has started, and what it says, in JSON lines."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from typing import Any


async def orders() -> AsyncIterator[dict[str, Any]]:
    """The lines of standard input until it ends."""
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    while line := await reader.readline():
        yield json.loads(line)


def say(what: Any) -> None:
    """Write one line, whole: threads may, each for itself."""
    sys.stdout.write(f"{json.dumps(what)}\n")
    sys.stdout.flush()
