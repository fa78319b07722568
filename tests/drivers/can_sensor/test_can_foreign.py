"""The driver at a sensor that only python-can and cantools make: a log, played as ``can.player`` plays it."""

from __future__ import annotations

import numpy as np
import pytest

from .rig import KERNEL, running, settings
from .test_can_map import DBC, GOOD

can = pytest.importorskip("can", reason="python-can is not installed")
cantools = pytest.importorskip("cantools", reason="cantools is not installed")

SPEEDS = np.arange(-30, 30)


async def test_a_log_of_cantools_frames_played_by_python_can(tmp_path, bus):
    (tmp_path / "drive.dbc").write_text(DBC)
    (tmp_path / "drive.yaml").write_text(GOOD)
    frame = cantools.database.load_file(tmp_path / "drive.dbc").get_message_by_name("Drive_Status")
    log = str(tmp_path / "drive.blf")
    with can.Logger(log) as writer:
        for number, speed in enumerate(SPEEDS.tolist()):
            data = frame.encode({"Speed": speed, "Energy": 3, "Odd": 0, "Number": number})
            arbitration = {"arbitration_id": frame.frame_id, "is_extended_id": False}
            writer.on_message_received(can.Message(**arbitration, data=data, timestamp=1000 + 0.01 * number))
    with can.LogReader(log) as reader:
        bus.put(*reader)
        async with running(settings(KERNEL, map=str(tmp_path / "drive.yaml"))) as run:
            await run.inlet.until(lambda o: o.account.received >= len(SPEEDS))
    found = run.inlet.stream("status")
    assert found[:, 0] == pytest.approx(SPEEDS * 2 * np.pi / 60)
    assert found[:, 1] == pytest.approx(3 * 3600.0)
    assert run.inlet.account.missed == {}
    assert not run.failures
