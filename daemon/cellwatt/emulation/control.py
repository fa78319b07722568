"""Control of emulators by JSON lines: commands on standard input, an answer to each on standard output."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from cellwatt.errors import CellwattError


async def answers(answer: Callable[[dict[str, Any]], Awaitable[Mapping[str, Any]]]) -> None:
    """Answer each line of standard input until it ends; a command that ``answer`` refuses is answered with an error."""
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    while line := await reader.readline():
        try:
            message = json.loads(line)
            if not isinstance(message, dict):
                raise ValueError("expected a JSON object")  # noqa: TRY004  # reported like any other error
            say(await answer(message))
        except (ValueError, TypeError, CellwattError) as error:
            say({"error": str(error)})


def say(message: Mapping[str, Any]) -> None:
    """Write one line to standard output."""
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()
