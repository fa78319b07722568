"""`train collect` on a running daemon and an emulated controller: stopped in the middle, it goes on."""

from __future__ import annotations

import asyncio
import csv
import json
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from tests.patience import PATIENCE
from tests.system.running import Daemon

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(120)]

POSES = np.array(
    [[0.4, 0.1, -0.3, 0.5, 0.2, 0.1], [-0.4, 0.3, -0.8, -0.5, 0.9, 0.7], [0.1, -0.2, -0.1, 0.3, -0.6, -0.9]]
)
TORQUE = np.array([[12, 30, -20, 3.0, 1.5, 1.0], [-12, 60, -15, -3.0, 3.0, 2.0], [6, -18, 9, 1.5, -4.5, -1.0]])
RATED = np.array([120.0, 120.0, 60.0, 15.0, 15.0, 10.0])
MOVE, HOLD = 0.5, 3.0


def write_motion(path: Path) -> None:
    """The poses again and again; 0.5 s from each to the next, 3 s in each."""
    step, rows = 0.02, []
    for here, there in ((i, (i + 1) % len(POSES)) for i in range(len(POSES))):
        way = np.linspace(0, 1, round(MOVE / step), endpoint=False)[:, None]
        rows.append(np.hstack([(1 - way) * a[here] + way * a[there] for a in (POSES, TORQUE)]))
        rows.append(np.repeat(np.hstack([POSES[there], TORQUE[there]])[None], round(HOLD / step), axis=0))
    table = np.concatenate(rows)
    names = [f"joint_{j}.{what}" for what in ("position", "torque") for j in range(1, 7)]
    lines = [",".join(["t", *names])]
    lines += [",".join(f"{x:.8f}" for x in (step * i, *row)) for i, row in enumerate(table)]
    path.write_text("\n".join(lines) + "\n")


async def collect(daemon: Daemon, folder: Path, stop_after: int | None) -> list[dict[str, int]]:
    """Runs the command until the plan is done, or interrupts it after so many poses."""
    words = ["train", "collect", str(daemon.file), "--out", str(folder / "poses.csv"), "--json"]
    words += ["--plan", str(folder / "plan.csv"), "--seconds", "60"]
    child = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "cellwatt.commands", *words, stdout=asyncio.subprocess.PIPE
    )
    assert child.stdout is not None
    seen = []
    async for line in child.stdout:
        seen.append(json.loads(line))
        if stop_after is not None and seen[-1]["held"] >= stop_after:
            child.send_signal(signal.SIGINT)
            break
    assert await asyncio.wait_for(child.wait(), PATIENCE) == 0
    return seen


def samples_of(daemon: Daemon, starts: NDArray[np.float64]) -> list[int]:
    """How many frames have all values in the 2 s from each start, UTC s, on: fewer than 101 where polls were missed."""
    frames = Recording.open(daemon.folder / "record").frames_table()
    columns = [
        frames.layout.index(f"arm.joint_{j}.{what}") for what in ("position", "torque_ratio") for j in range(1, 7)
    ]
    time = frames.time[np.isfinite(frames.values[:, columns]).all(axis=1)]
    first = [np.argmin(np.abs(time - start * 1e9)) for start in starts]
    last = [np.searchsorted(time, time[i] + 2_000_000_000 - 1_000_000) for i in first]
    return [int(b - a + 1) for a, b in zip(first, last, strict=True)]


async def test_a_collection_is_stopped_and_goes_on(tmp_path: Path) -> None:
    write_motion(tmp_path / "motion.csv")
    with (tmp_path / "plan.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["pose", *(f"q_{j}" for j in range(1, 7))])
        writer.writerows([i, *pose] for i, pose in enumerate(POSES.tolist()))
    arguments = ("--listen", "127.0.0.1:0", "--recording", str(tmp_path / "motion.csv"), "--loop")
    async with EmulatorProcess("yaskawa", *arguments) as device:
        host, port = device.address.split(":")
        pulses = [1341.4, 1341.4, 1341.4, 1000, 1000, 622]
        text = f"sources:\n  arm: {{driver: yaskawa, host: {host}, port: {port}, pulses_per_degree: {pulses}}}\n"
        async with Daemon(tmp_path, text) as daemon:
            first = await collect(daemon, tmp_path, stop_after=1)
            second = await collect(daemon, tmp_path, stop_after=None)
            assert await daemon.stop() == 0
    assert first[-1]["held"] >= 1
    assert second[0]["held"] == first[-1]["held"]
    assert (second[-1]["planned"], second[-1]["total"]) == (3, 3)
    table = np.genfromtxt(tmp_path / "poses.csv", delimiter=",", names=True)
    held = np.stack([table[f"q_{j}"] for j in range(1, 7)], axis=1)
    torque = np.stack([table[f"torque_ratio_{j}"] for j in range(1, 7)], axis=1) * RATED
    which = np.argmin(np.abs(held[:, None] - POSES).max(axis=2), axis=1)
    np.testing.assert_allclose(held, POSES[which], atol=1e-4)
    np.testing.assert_allclose(torque, TORQUE[which], atol=0.006 * RATED.max())
    assert table["count"].tolist() == samples_of(daemon, table["t"])
    came = np.stack([table[f"q_from_{j}"] for j in range(1, 7)], axis=1)
    ways = POSES[which] - POSES[(which - 1) % 3]
    known = np.isfinite(came)
    np.testing.assert_array_equal(np.sign(held - came)[known], np.sign(ways)[known])
    assert known[-1].all()
