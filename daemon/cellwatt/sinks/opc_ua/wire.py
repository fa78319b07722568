"""Messages between the daemon and the process that serves over OPC UA: lines of JSON."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from typing import Any

from cellwatt.errors import ProtocolError


def message(kind: str, content: Mapping[str, Any]) -> bytes:
    """A message as a line."""
    return json.dumps([kind, content], allow_nan=False).encode() + b"\n"


async def received(reader: asyncio.StreamReader) -> tuple[str, dict[str, Any]] | None:
    """Return the next message; ``None`` at the end. Raises ``ProtocolError`` for what is none."""
    try:
        line = await reader.readline()
        if not line.endswith(b"\n"):
            return None
        kind, content = json.loads(line)
    except (ValueError, TypeError) as error:
        raise ProtocolError(f"no message: {error}") from error
    except ConnectionError:
        return None
    return str(kind), dict(content)
