"""The supervisor where the PC has no room for another process."""

from __future__ import annotations

import errno
import os
import selectors
import time
from unittest.mock import Mock

import pytest

from cellwatt.runtime.processes.supervisor import Supervisor
from tests.daemon.runtime.fakes import config_of


def test_a_process_that_cannot_be_begun_now_is_tried_again_and_ends_nobody(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = Supervisor(config_of())
    daemon._selector = selectors.DefaultSelector()
    daemon._align.again_at = 0.0
    monkeypatch.setattr(os, "fork", Mock(side_effect=OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))))
    daemon._turn()
    assert "the process align cannot be started: Resource temporarily unavailable" in caplog.text
    assert daemon._align.again_at > time.monotonic() and not daemon._align.alive
