"""The installed ur-rtde library as a client of the emulator."""

from __future__ import annotations

import asyncio
import csv
import json
import sys

import numpy as np
import pytest

from cellwatt.emulation import EmulatorProcess
from tests.patience import PATIENCE

from .recordings import write

pytest.importorskip("rtde_receive", reason="the ur-rtde library is not installed")

# The library has no other port; each test takes a loopback address of its own. Its constructor holds the
# GIL, so it always lives in a process of its own here.
PORT = 30004

READ = """
import json, sys, time
from rtde_receive import RTDEReceiveInterface
host, rate, names, path, record, patience = json.loads(sys.argv[1])
library = RTDEReceiveInterface(host, rate, names)
if path:
    assert library.startFileRecording(path, record)
seen = {}
end = time.monotonic() + patience
while len(seen) < 150 and time.monotonic() < end:
    stamp = library.getTimestamp()
    q = library.getActualQ()
    if library.getTimestamp() == stamp:
        seen[stamp] = q
    time.sleep(0.0005)
if path:
    library.stopFileRecording()
answer = {"seen": sorted(seen.items()), "connected": library.isConnected()}
for name in ("RobotMode", "SafetyMode", "RuntimeState", "ActualRobotVoltage", "JointTemperatures", "PayloadInertia"):
    try:
        answer[name] = getattr(library, "get" + name)()
    except RuntimeError:
        answer[name] = None
library.disconnect()
print(json.dumps(answer))
"""


async def read(host, rate=-1.0, names=(), path="", record=()):
    """What the library gives until there are enough packages."""
    words = json.dumps([host, rate, names, str(path), record, PATIENCE])
    child = await asyncio.create_subprocess_exec(sys.executable, "-c", READ, words, stdout=asyncio.subprocess.PIPE)
    async with asyncio.timeout(PATIENCE):
        out, _ = await child.communicate()
    assert child.returncode == 0
    return json.loads(out.splitlines()[-1])


async def test_its_default_variables_are_served():
    options = ("--option", "polyscope=5.23.0")
    async with EmulatorProcess("ur", "--listen", f"127.0.31.2:{PORT}", *options) as emulator:
        answer = await read("127.0.31.2")
        stamps = [stamp for stamp, _ in answer["seen"]]
        assert answer["connected"]
        assert len(stamps) > 50
        cycles = np.diff(stamps) * 500
        np.testing.assert_allclose(cycles, np.rint(cycles), atol=1e-6)
        assert answer["RobotMode"] == 7 and answer["SafetyMode"] == 1 and answer["RuntimeState"] == 2
        assert answer["ActualRobotVoltage"] == pytest.approx(48, abs=1)
        assert answer["PayloadInertia"] is not None
        counts = await emulator.counts()
        assert counts["sent"] > 50


async def test_chosen_variables_and_its_recorder(tmp_path):
    rows = write(tmp_path / "served.csv", 1000.4 + 0.002 * np.arange(700))
    names = ["timestamp", "actual_q", "actual_current", "robot_mode", "joint_mode"]
    path = tmp_path / "written.csv"
    options = ("--listen", f"127.0.31.3:{PORT}", "--recording", str(tmp_path / "served.csv"))
    async with EmulatorProcess("ur", *options):
        answer = await read("127.0.31.3", 500.0, names, path)
    truth = {row[0]: row for row in rows.tolist()}
    for stamp, q in answer["seen"]:
        assert q == truth[stamp][1:7]
    with path.open() as file:
        written = list(csv.DictReader(file))
    assert list(written[0]) == [
        "timestamp",
        *(f"{n}_{i}" for n in ("actual_q", "actual_current") for i in range(6)),
        "robot_mode",
        *(f"joint_mode_{i}" for i in range(6)),
    ]
    assert len(written) > 100
    place = {round(stamp, 6): i for i, stamp in enumerate(rows[:, 0].tolist())}
    whole = 0
    for row in written:
        i = place[float(row["timestamp"])]
        # Packages that come while its recorder writes a row give the rest of that row.
        matches = np.abs(float(row["actual_q_5"]) - rows[i:, 6]) < 6e-7
        assert matches.any()
        whole += matches[0]
        assert row["robot_mode"] == "7" and row["joint_mode_0"] == "253"
    assert whole > 0.9 * len(written)
