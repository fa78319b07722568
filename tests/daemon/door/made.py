"""Certificates for the tests of doors."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from cellwatt.door.certificates import issue, new_authority


def write_certificates(folder: Path) -> Path:
    """Write an authority's certificate ``ca``, and for this PC ``cell`` and ``cell.key``; gives the folder."""
    now = datetime.now(UTC)
    authority = new_authority("plant-1", now)
    cell = issue(authority, "cell", ("localhost", "127.0.0.1"), now)
    for name, content in {"ca": authority.certificate, "cell": cell.certificate, "cell.key": cell.key}.items():
        (folder / name).write_bytes(content)
        (folder / name).chmod(0o600)
    return folder
