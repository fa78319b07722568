"""The ways in which the settings of a cell let others than this PC in. Pure.

Two settings are safe: listening on this PC alone; or TLS together with access rules that deny what they do not allow
(``options: {access_control: …}``, which ``cellwatt secure`` writes).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from cellwatt.host import stays_here
from cellwatt.outlets.zenoh.link import LinkSettings, session_config

_NETWORK = re.compile(r"(tcp|udp|tls|quic|ws)/(\[.*\]|[^/]+):\d+(?:[?#].*)?")
_ENCRYPTED: Final = ("tls", "quic")
_HARM: Final = "whoever reaches it can read everything and speak in the cell's name"


@dataclass(frozen=True, slots=True)
class Opening:
    """A way in for strangers: the setting, its value, and the consequence in words."""

    at: tuple[str | int, ...]
    value: str
    text: str


def openings(settings: LinkSettings) -> Iterator[Opening]:
    """All ways into the cell from other PCs without TLS and access rules."""
    ruled = _denies(settings)
    for i, endpoint in enumerate(settings.listen):
        protocol = _protocol(endpoint)
        missing = ["TLS"] if protocol not in _ENCRYPTED else []
        missing += [] if ruled else ["access rules"]
        if protocol is not None and missing:
            text = f"open to the network without {' and '.join(missing)}: {_HARM}"
            yield Opening(("listen", i), endpoint, text)
    if settings.scouting:
        yield Opening(("scouting",), "scouting", f"finds, and links with, anybody on the local network: {_HARM}")


def _protocol(endpoint: str) -> str | None:
    """The protocol by which other PCs reach an endpoint; ``None`` if they cannot."""
    found = _NETWORK.fullmatch(endpoint)
    if found is None:
        return None  # a socket, pipe or serial line of this PC
    return None if stays_here(found[2].strip("[]")) else found[1]


def _denies(settings: LinkSettings) -> bool:
    """True if access rules are in force and deny by default, in whatever form they are written."""
    control: dict[str, Any] = json.loads(session_config(settings).get_json("access_control"))
    return bool(control.get("enabled")) and control.get("default_permission") == "deny"
