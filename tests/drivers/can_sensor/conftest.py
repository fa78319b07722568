from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from cellwatt_drivers.can_sensor import listening

from .rig import ScriptedBus


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedBus]:
    """The bus that a driver finds at ``KERNEL``."""
    with closing(ScriptedBus()) as made:
        monkeypatch.setattr(listening, "_open", lambda place: made)
        yield made
