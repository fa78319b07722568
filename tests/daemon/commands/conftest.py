"""The commands are tested with the parts and the file of the settings tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.daemon.config.conftest import _fake_parts, cell_file, real_parts
from tests.daemon.outlets.zenoh.processes import Child, free_port

__all__ = ["_fake_parts", "cell_file", "real_parts"]


@pytest.fixture(scope="module")
def live() -> Iterator[tuple[Child, str]]:
    """A cell on a bus, and where it listens."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Child("cell_process", listen=[endpoint]) as cell:
        yield cell.ready(), endpoint
