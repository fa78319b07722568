"""What nobody ever took, in a file for a person to look at."""

from __future__ import annotations

import os
from pathlib import Path


def put_aside(path: Path, content: bytes, largest: int, mode: int = 0o600) -> bool:
    """Add to a file, and sync it; one of ``largest`` bytes becomes ``.1`` first, in place of the one before.

    True if an older file was thrown away for it. Raises ``OSError``. Blocks.
    """
    thrown = False
    if path.exists() and path.stat().st_size + len(content) > largest:
        old = path.with_name(f"{path.name}.1")
        thrown = old.exists()
        path.replace(old)
    flags = os.O_CLOEXEC | os.O_NOFOLLOW
    with open(path, "ab", opener=lambda name, how: os.open(name, how | flags, mode)) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    return thrown
