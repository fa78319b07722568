"""Finds other daemons that publish as the same cell: the settings file was copied, and its name not changed."""

from __future__ import annotations

import socket
import time
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote

from cellwatt.outlets.zenoh.keys import CellKeys

if TYPE_CHECKING:
    import zenoh

PATIENCE: Final = 15.0
"""Time, s, after which a token is not that of a daemon which has just ended: longer than Zenoh's lease of a link."""


class Namesakes:
    """Liveliness tokens of the daemons that publish as one cell, one for each PC and session (start, UTC ns)."""

    def __init__(self, bus: zenoh.Session, keys: CellKeys, session: int) -> None:
        self._cell = f"{keys.site}/{keys.cell}"
        self._own = keys.daemon(socket.gethostname(), session)
        self._since: dict[str, float] = {}
        """Time at which each other token appeared, monotonic s, by its key."""
        self._token = bus.liveliness().declare_token(self._own)
        bus.liveliness().declare_subscriber(keys.daemons, self._hear, history=True)

    def _hear(self, sample: zenoh.Sample) -> None:
        """Note a token that appears or disappears. Runs in Zenoh's thread."""
        import zenoh

        key = str(sample.key_expr)
        if sample.kind != zenoh.SampleKind.PUT:
            self._since.pop(key, None)
        elif key != self._own:
            self._since.setdefault(key, time.monotonic())

    def trouble(self) -> str | None:
        """Where another daemon publishes as this cell, or ``None``."""
        before = time.monotonic() - PATIENCE
        for key, since in tuple(self._since.items()):
            if since <= before:
                host, session = key.split("/")[-2:]
                start = datetime.fromtimestamp(int(session) // 10**9, UTC)
                return (
                    f"a second daemon publishes as {self._cell}: on {unquote(host)}, started {start:%Y-%m-%d %H:%M:%S} "
                    "UTC; consumers mix the data of the two: give each cell a name of its own ('cell' in its file)"
                )
        return None
