"""A campaign at the terminal: a running daemon, an emulated arm and analyzer, and the files that come out."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.emulation import EmulatorProcess
from tests.patience import PATIENCE
from tests.system.running import Audience, Daemon, free_port, running

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(600)]

BENCH = Path(__file__).resolve().parents[2] / "bench"
SPEEDS = (500.0, 700.0)
LEAD, OFF = 30.0, 20.0
"""s of rest before a program, for the sources to come back; W that say that it is over."""


def table(path: Path, time: np.ndarray, columns: dict[str, np.ndarray]) -> Path:
    pq.write_table(pa.table({"t": time, **columns}), path)
    return path


def write_level(path: Path, watt: float) -> Path:
    t = np.arange(0, 60, 0.1)
    return table(path, t, {"supply.power": watt + np.random.default_rng(round(watt)).normal(0, 0.05, len(t))})


def write_motion(path: Path, rows: np.ndarray, constant: np.ndarray) -> Path:
    """Positions, velocities and currents at 100 Hz."""
    rows = rows[::5]
    rows[:, 12:] /= constant
    kinds = ("position", "velocity", "current")
    names = [f"joint_{i}.{kind}" for kind in kinds for i in range(1, 7)]
    return table(path, np.arange(len(rows)) * 0.01, dict(zip(names, rows.T, strict=True)))


def write_program(folder: Path, plant, payload: float) -> tuple[Path, Path]:
    rows, watts = plant.programme(payload, SPEEDS, 2, np.random.default_rng(3))
    lead = round(LEAD * 500)
    rows, watts = (np.concatenate([np.repeat(x[:1], lead, axis=0), x]) for x in (rows, watts))
    rows, watts = (np.concatenate([x, np.repeat(x[-1:], 1500, axis=0)]) for x in (rows, watts))
    means = watts[: len(watts) // 50 * 50].reshape(-1, 50).mean(axis=1)
    over = np.concatenate([means, [OFF, OFF]])
    analyzer = table(folder / f"{payload:g}.supply.parquet", np.arange(len(over)) * 0.1, {"supply.power": over})
    return write_motion(folder / f"{payload:g}.arm.parquet", rows, plant.constant), analyzer


class Devices:
    """The arm and the analyzer of the cell, each at its address, playing one table after another."""

    def __init__(self, audience: Audience) -> None:
        self.ports = {"ur": free_port(), "scpi_analyzer": free_port()}
        self.audience = audience
        self._stack = {kind: contextlib.AsyncExitStack() for kind in self.ports}

    async def play(self, kind: str, recording: Path, *more: str, epoch: float | None = None) -> None:
        await self._stack[kind].aclose()
        words = ["--listen", f"127.0.0.1:{self.ports[kind]}", "--recording", str(recording), *more]
        words += [] if epoch is None else ["--epoch", repr(epoch)]
        await self._stack[kind].enter_async_context(EmulatorProcess(kind, *words))

    async def close(self) -> None:
        for stack in self._stack.values():
            await stack.aclose()

    async def power_between(self, low: float, high: float, seconds: float = PATIENCE) -> None:
        """Wait until the analyzer's newest value is there."""

        def there(audience: Audience) -> bool:
            batches = audience.batches["raw/supply/measured"]
            if not batches:
                return False
            power = batches[-1].values[-1, batches[-1].stream.names.index("supply.power")]
            return bool(low < power < high)

        await self.audience.until(there, seconds)


class Operator:
    """The command as a child: waits for its questions and answers them."""

    def __init__(self, child: asyncio.subprocess.Process) -> None:
        self._child = child
        self.heard = ""
        self._read = 0

    async def asked(self, question: str, seconds: float = 120.0) -> None:
        assert self._child.stdout is not None
        async with asyncio.timeout(seconds):
            while question not in self.heard[self._read :]:
                part = await self._child.stdout.read(4096)
                assert part, f"ended before {question!r}:\n{self.heard}"
                self.heard += part.decode()
        self._read = self.heard.index(question, self._read) + len(question)

    def answer(self, text: str = "") -> None:
        assert self._child.stdin is not None
        self._child.stdin.write(f"{text}\n".encode())

    async def end(self) -> int:
        assert self._child.stdout is not None
        self.heard += (await self._child.stdout.read()).decode()
        return await asyncio.wait_for(self._child.wait(), PATIENCE)


async def command(*words: str | Path) -> asyncio.subprocess.Process:
    code = "from cellwatt_plugins.energy.procedure.command import campaign; campaign()"
    pipe = asyncio.subprocess.PIPE
    merged = asyncio.subprocess.STDOUT
    return await asyncio.create_subprocess_exec(
        sys.executable, "-u", "-c", code, *map(str, words), stdin=pipe, stdout=pipe, stderr=merged
    )


@contextlib.asynccontextmanager
async def cell(folder: Path) -> AsyncIterator[tuple[Daemon, Devices]]:
    ur, scpi = free_port(), free_port()
    text = f"sources:\n  arm: {{driver: ur, host: 127.0.0.1, port: {ur}}}\n"
    text += f"  supply: {{driver: scpi_analyzer, host: 127.0.0.1, port: {scpi}, functions: [URMS, P]}}\n"
    async with running(folder, text) as (daemon, audience):
        devices = Devices(audience)
        devices.ports = {"ur": ur, "scpi_analyzer": scpi}
        try:
            yield daemon, devices
        finally:
            await devices.close()


async def test_a_campaign_at_the_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    from tests.plugins.energy.procedure.plant import UR5E, Arm

    plant = Arm(UR5E)
    robot = plant.describe(tmp_path / "robot")
    child = await command("rest-pose", "--robot", robot, "--json")
    assert child.stdout is not None
    pose = np.array(json.loads(await child.stdout.read())["joints"])
    resting = np.repeat(np.concatenate([pose, np.zeros(12)])[None], 500, axis=0)
    still = write_motion(tmp_path / "still.parquet", resting, plant.constant)
    levels = {"controller": 54.03, "connected": 81.41, "released": 85.8}
    async with cell(tmp_path) as (daemon, devices):
        await devices.play("ur", still, "--option", "at_end=hold")
        out = tmp_path / "out"
        speeds = ",".join(f"{speed:g}" for speed in SPEEDS)
        words = ["measure", daemon.file, "--robot", robot, "--out", out, "--speeds", speeds]
        operator = Operator(await command(*words, "--repetitions", "2", "--seconds", "5"))
        for name, watt in levels.items():
            await devices.play("scpi_analyzer", write_level(tmp_path / f"{name}.parquet", watt), "--loop")
            await devices.power_between(watt - 1, watt + 1)
            await operator.asked("Press Enter when it is so")
            operator.answer()
            await operator.asked("a to accept")
            operator.answer()
        for payload in (0.0, 5.0):
            motion, power = write_program(tmp_path, plant, payload)
            await operator.asked("Press Enter, then start the program")
            operator.answer()
            epoch = time.time()
            await devices.play("ur", motion, "--option", "at_end=hold", "--option", "start=epoch", epoch=epoch)
            await devices.play("scpi_analyzer", power, epoch=epoch)
            await operator.asked("Press Enter when the program has ended")
            await devices.power_between(OFF + 20, 1000.0)
            await devices.power_between(OFF - 1, OFF + 1, 150.0)
            operator.answer()
            await operator.asked("a to accept")
            assert f"700_{payload:g}kg: 2 of 2 repetitions" in operator.heard, operator.heard
            operator.answer()
        assert await operator.end() == 0, operator.heard
    assert "500_5kg: 2 of 2 repetitions" in operator.heard, operator.heard
    check(tmp_path, operator.heard, plant, levels)


def check(folder: Path, heard: str, plant, levels: dict[str, float]) -> None:
    """The files give what arm and analyzer truly had."""
    out = folder / "out"
    assert "cellwatt disaggregate --robot" in heard
    for name, watt in levels.items():
        assert pq.read_table(out / f"{name}.parquet")["power"].to_numpy().mean() == pytest.approx(watt, abs=0.05)
    for speed in SPEEDS:
        for payload in (0, 5):
            robot = pq.read_table(out / "runs" / f"{speed:g}_{payload}kg.robot.parquet")
            power = pq.read_table(out / "runs" / f"{speed:g}_{payload}kg.analyzer.parquet")
            true = plant.truth(speed, float(payload))
            moving = np.abs(np.stack([robot[f"qd_{i}"] for i in range(1, 7)], axis=1)).max(axis=1) > 0.01
            step = float(np.median(np.diff(robot["t"].to_numpy())))
            assert moving.sum() * step == pytest.approx(2 * true["seconds"], rel=0.1)
            above = power["power"].to_numpy() - power["power"].to_numpy()[:5].mean()
            idle = (
                plant.made.fixed
                + plant.powers(
                    plant.torque(*(np.vstack([plant.way[0](0.0)]) * k for k in (1, 0, 0)), float(payload)),
                    np.zeros((1, 6)),
                )["supply"][0]
            )
            drawn = above.sum() * 0.1
            assert drawn == pytest.approx(2 * (true["total"] - idle * true["seconds"]), rel=0.1, abs=2.0)
