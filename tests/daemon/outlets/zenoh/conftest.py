from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cellwatt.outlets.zenoh import link

sys.path.append(str(Path(__file__).resolve().parents[4] / "bench"))


@pytest.fixture
def soon_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is refused is told so within two seconds, not six."""
    monkeypatch.setattr(link, "_ATTEMPTS", (0.5, 0.5, 0.5))
