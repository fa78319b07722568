"""The installed ur-rtde library as a client of the emulator."""

from __future__ import annotations

import asyncio
import json
import sys

import numpy as np
import pytest

from cellwatt.emulation import EmulatorProcess
from tests.patience import PATIENCE

from .recordings import write

pytest.importorskip("rtde_receive", reason="the ur-rtde library is not installed")

# The library has no other port. Its constructor holds the GIL, so it always lives in a process of its own here.
PORT = 30004

READ = """
import json, sys, time
from rtde_receive import RTDEReceiveInterface
host, patience = json.loads(sys.argv[1])
library = RTDEReceiveInterface(host)
seen = {}
end = time.monotonic() + patience
while len(seen) < 150 and time.monotonic() < end:
    stamp = library.getTimestamp()
    q = library.getActualQ()
    if library.getTimestamp() == stamp:
        seen[stamp] = q
    time.sleep(0.0005)
answer = {"seen": sorted(seen.items()), "connected": library.isConnected()}
for name in ("RobotMode", "SafetyMode", "RuntimeState", "ActualRobotVoltage", "JointTemperatures", "PayloadInertia"):
    try:
        answer[name] = getattr(library, "get" + name)()
    except RuntimeError:
        answer[name] = None
library.disconnect()
print(json.dumps(answer))
"""


async def read(host):
    """What the library gives until there are enough packages."""
    words = json.dumps([host, PATIENCE])
    child = await asyncio.create_subprocess_exec(sys.executable, "-c", READ, words, stdout=asyncio.subprocess.PIPE)
    async with asyncio.timeout(PATIENCE):
        out, _ = await child.communicate()
    assert child.returncode == 0
    return json.loads(out.splitlines()[-1])


async def test_its_default_variables_are_served(tmp_path):
    truth = {row[0]: row for row in write(tmp_path / "served.csv", 1000.4 + 0.002 * np.arange(700)).tolist()}
    options = ("--option", "polyscope=5.23.0", "--recording", str(tmp_path / "served.csv"))
    async with EmulatorProcess("ur", "--listen", f"127.0.31.2:{PORT}", *options) as emulator:
        answer = await read("127.0.31.2")
        stamps = [stamp for stamp, _ in answer["seen"]]
        assert answer["connected"]
        assert len(stamps) > 50
        cycles = np.diff(stamps) * 500
        np.testing.assert_allclose(cycles, np.rint(cycles), atol=1e-6)
        assert answer["RobotMode"] == 7 and answer["SafetyMode"] == 1 and answer["RuntimeState"] in (2, 4)
        assert answer["ActualRobotVoltage"] == pytest.approx(48, abs=1)
        assert answer["PayloadInertia"] is not None
        assert all(q == truth[stamp][1:7] for stamp, q in answer["seen"])
        counts = await emulator.counts()
        assert counts["sent"] > 50
