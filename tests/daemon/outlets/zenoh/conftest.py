from __future__ import annotations

import pytest

from cellwatt.outlets.zenoh import link


@pytest.fixture
def soon_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is refused is told so within two seconds, not six."""
    monkeypatch.setattr(link, "_ATTEMPTS", (0.5, 0.5, 0.5))
