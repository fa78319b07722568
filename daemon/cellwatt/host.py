"""Names and addresses of hosts in settings."""

from __future__ import annotations

import ipaddress
import re
from typing import Annotated, Final

from pydantic import AfterValidator

LONGEST: Final = 253
"""Characters of a host name, of each of its parts 63 (RFC 1123)."""
_NAME = re.compile(r"(?:(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\.)*(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\.?")
_NUMBERS = re.compile(r"[0-9]+(?:\.[0-9]+){3}")


def check_host(host: str) -> str:
    """Return the host unchanged. Raises ``ValueError`` if it is neither a host name nor an IP address."""
    if len(host) > LONGEST:
        raise ValueError(f"a host name has at most {LONGEST} characters, this one has {len(host):,}")
    if _NUMBERS.fullmatch(host) and not _is_address(host):
        raise ValueError("expected an IP address of four numbers from 0 to 255, like 192.0.2.10")
    if not _NAME.fullmatch(host) and not _is_address(host):
        raise ValueError("expected a host name or an IP address, like 192.0.2.10 or arm-3.plant")
    return host


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


Host = Annotated[str, AfterValidator(check_host)]
"""A host name or an IP address."""
