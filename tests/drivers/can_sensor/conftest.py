from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import can
import pytest

from .rig import ScriptedBus


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedBus]:
    """The bus that a driver finds at ``KERNEL``, if it asks for frames of CAN FD."""
    with closing(ScriptedBus()) as made:
        monkeypatch.setattr(can, "Bus", lambda fd, **_: {True: made}[fd])
        yield made
