"""What tests of several packages of the daemon share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """A folder with two cells' keys."""
    from cellwatt.door.signing import new_key

    for name in ("cell", "other"):
        private, public = new_key()
        (tmp_path / f"{name}.key").write_bytes(private)
        (tmp_path / f"{name}.pub").write_bytes(public)
    return tmp_path
