"""Messages that nobody got, with the reason: ``notify-undelivered.jsonl`` beside the recordings."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Final

from cellwatt.outlets.notify.texts import About, payload
from cellwatt.outlets.notify.told import Message

FILE: Final = "notify-undelivered.jsonl"
LARGEST: Final = 1_000_000
"""Bytes of the file; then it is put aside as ``notify-undelivered.jsonl.1``, in place of the one before."""


def line(about: About, to: str, message: Message, reason: str, now: str) -> bytes:
    """One line for a message that is given up at ``now``."""
    return json.dumps({"time": now, "to": to, "reason": reason, **payload(about, message)}).encode() + b"\n"


def keep(path: Path, content: bytes, largest: int = LARGEST) -> bool:
    """Add a line; return True if an older file was thrown away for it. Raises ``OSError``. Blocks."""
    thrown = False
    if path.exists() and path.stat().st_size + len(content) > largest:
        old = path.with_name(f"{path.name}.1")
        thrown = old.exists()
        path.replace(old)
    with open(path, "ab", opener=_private) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return thrown


def _private(name: str, flags: int) -> int:
    """Open a file that only its owner may read."""
    return os.open(name, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
