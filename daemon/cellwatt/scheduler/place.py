"""Names of schedulers as a command line has them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import urlsplit

EXPECTED = "expected local, local:2 (that many workers), tcp://host:8786 or tls://host:8786"


@dataclass(frozen=True, slots=True)
class Place:
    """The dask scheduler at ``address``, or ``workers`` processes of this machine (None: one a core)."""

    address: str | None = None
    workers: int | None = None


def parse_place(text: str) -> Place:
    """Read the name of a scheduler. Raises ``ValueError`` with what was expected."""
    if local := re.fullmatch(r"local(?::([1-9]\d{0,2}))?", text):
        return Place(workers=None if local[1] is None else int(local[1]))
    try:
        parts = urlsplit(text)
        found = parts.scheme in ("tcp", "tls") and bool(parts.hostname and parts.port)
    except ValueError:  # a port that is none
        found = False
    if not found or parts.path.strip("/") or parts.username is not None or parts.query or parts.fragment:
        raise ValueError(f"{text!r} names no scheduler: {EXPECTED}")
    return Place(text.rstrip("/"))
