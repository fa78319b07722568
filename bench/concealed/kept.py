"""What a run keeps so that it goes on where it was stopped: cases, answers and scores, each with a stamp."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PRODUCT = ("daemon", "drivers", "plugins")
JUDGES = {"files", "judging", "kept", "page", "product", "runner", "scoring", "seal", "totals"}
"""Modules of this benchmark that do not change how a case is made."""


def digest_of(files: Iterable[Path]) -> str:
    """Twelve hex digits over names and contents."""
    total = hashlib.sha256()
    for file in sorted(files):
        total.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return total.hexdigest()[:12]


def making() -> str:
    """Digest of the code that makes the cases."""
    return digest_of(f for f in HERE.rglob("*.py") if f.stem not in JUDGES)


def judging() -> str:
    """Digest of the code that scores the answers."""
    return digest_of(f for f in HERE.glob("*.py") if f.stem in JUDGES)


def product() -> str:
    """Digest of the product that is beside the benchmark."""
    return digest_of(f for folder in PRODUCT for f in (ROOT / folder).rglob("*.py"))


def stamp(*words: object) -> str:
    """What a result depends on, as twelve hex digits."""
    return hashlib.sha256("\n".join(map(str, words)).encode()).hexdigest()[:12]


def write(file: Path, content: Any) -> None:
    """JSON in one step: whoever is stopped leaves the old file or the new one."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.name}.{os.getpid()}")
    part.write_text(json.dumps(content, indent=1))
    part.replace(file)


def read(file: Path, stamped: str) -> Any | None:
    """The content that was kept under this stamp, or None."""
    try:
        content = json.loads(file.read_text())
    except (OSError, ValueError):
        return None
    return content["content"] if content.get("stamp") == stamped else None


def keep(file: Path, stamped: str, content: Any) -> None:
    """Write content with its stamp."""
    write(file, {"stamp": stamped, "content": content})
