"""ECDP's four robots through the daemon: emulated arm and analyzer, recording, cut, `cellwatt disaggregate`."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from cellwatt_plugins.energy.procedure.cut import cut_programme, cut_state
from cellwatt_plugins.energy.procedure.recorded import motion_of, power_of
from cellwatt_plugins.robot import Arm
from tests.plugins.energy.running import MEASURED
from tests.system.running import Audience, free_port, running

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1200)]

BENCH = Path(__file__).resolve().parents[2] / "bench"
SPEEDS = (200.0, 250.0)
REPETITIONS, LEAST = 4, 2
"""A computer that is busy may lose so many samples that a repetition is refused."""
LEAD, READ, PAUSE = 20.0, 25.0, 3.0
"""s: rest before all, length of a reading, time between what is measured."""
OFF = 5.0
"""W that say that it is over."""
HOLD = 0.1
"""W that the motors take beside the brakes in the third reading."""
RATE = 100.0
"""Hz of the tables; the arm's signals are sampled, the analyzer's are means."""
NOISE = 0.25
"""W at that rate: 0.08 W of one value of the analyzer."""
DEVICES = {
    "UR5e": ("ur", ""),
    "UR10e": ("ur", ""),
    "FR3": ("franka", ", read: [joints], rate: 100 Hz"),
    "Gen3": ("kinova", ", read: [joints], axes: 7, rate: 40 Hz"),
}
OPTIONS = {
    "ur": ("--option", "at_end=hold", "--option", "start=epoch"),
    "franka": ("--option", "realtime=1"),
}
"""Of the emulators: a busy computer would hold up states that are due every millisecond."""
FRANKA = "127.0.9.3"
"""The vendor's library knows one port only: an address of its own."""


@dataclass(frozen=True)
class Day:
    """A campaign as the emulators play it."""

    arm: Path
    supply: Path
    seconds: float
    states: dict[str, tuple[float, float]]
    """Beginning and end of each reading, s after the epoch."""
    programmes: dict[float, tuple[float, float]]
    """The same of each program, by its payload."""


def write_day(folder: Path, plant) -> Day:
    """Readings and programs one after the other: the arm sampled, the analyzer's power averaged, at ``RATE``."""
    rng = np.random.default_rng(5)
    made = plant.made
    every = round(500 / RATE)
    levels: dict[str, float] = {"connected": made.controller + made.electronics, "released": made.fixed + HOLD}
    if made.separate:
        levels = {"controller": made.controller, **levels}
    programmes = {p: plant.programme(p, SPEEDS, REPETITIONS, rng) for p in (0.0, plant.cube.payload)}
    still = programmes[0.0][0][:1]
    rows, watts = [], []

    def add(row: np.ndarray, watt: np.ndarray) -> tuple[float, float]:
        begin = sum(map(len, watts)) / RATE
        rows.append(row)
        watts.append(watt)
        return begin, sum(map(len, watts)) / RATE

    def rest(watt: float, seconds: float) -> tuple[float, float]:
        count = round(seconds * RATE)
        return add(np.repeat(still, count, axis=0), np.full(count, watt))

    rest(made.fixed, LEAD)
    states: dict[str, tuple[float, float]] = {}
    for name, watt in levels.items():
        rest(watt, PAUSE)
        states[name] = rest(watt, READ)
        rest(watt, PAUSE)
    spans = {}
    for payload, (row, watt) in programmes.items():
        count = len(row) // every
        spans[payload] = add(row[: count * every : every], watt[: count * every].reshape(count, every).mean(axis=1))
        rest(float(watt[-1]), PAUSE)
    seconds = rest(made.fixed, PAUSE)[1]
    rest(0.0, 5.0)
    return Day(
        write_arm(folder / "arm.parquet", np.vstack(rows), plant),
        write_supply(folder / "supply.parquet", np.concatenate(watts), rng),
        seconds,
        states,
        spans,
    )


def write_arm(path: Path, rows: np.ndarray, plant) -> Path:
    """Torque where the arm measures it, else current."""
    n = plant.made.joints
    if plant.made.by_current:
        rows[:, 2 * n :] /= plant.constant
    kinds = ("position", "velocity", "current" if plant.made.by_current else "torque")
    names = [f"joint_{i}.{kind}" for kind in kinds for i in range(1, n + 1)]
    pq.write_table(pa.table({"t": np.arange(len(rows)) / RATE, **dict(zip(names, rows.T, strict=True))}), path)
    return path


def write_supply(path: Path, watts: np.ndarray, rng: np.random.Generator) -> Path:
    noisy = watts + NOISE * rng.standard_normal(len(watts)) * (watts > 0)
    pq.write_table(pa.table({"t": (np.arange(len(watts)) + 0.5) / RATE, "supply.power": noisy}), path)
    return path


def powered_off(audience: Audience) -> bool:
    """The supply was on, which it is not before the day begins, and is off."""
    batches = audience.batches["raw/supply/measured"]
    power = [batch.values[-1, batch.stream.names.index("supply.power")] for batch in batches]
    return bool(power and max(power) > OFF > power[-1])


async def record(folder: Path, day: Day, robot: str) -> float:
    """Play the day to a daemon that records it; returns its epoch, UTC s."""
    driver, more = DEVICES[robot]
    host, port = (FRANKA, 1337) if driver == "franka" else ("127.0.0.1", free_port())
    also = "" if driver == "franka" else f", port: {port}"
    scpi = free_port()
    text = f"sources:\n  arm: {{driver: {driver}, host: {host}{also}{more}}}\n"
    text += f"  supply: {{driver: scpi_analyzer, host: 127.0.0.1, port: {scpi}, functions: [URMS, P]}}\n"
    epoch = time.time() + 3.0
    clock = ("--epoch", repr(epoch))
    arm = ("--listen", f"{host}:{port}", "--recording", str(day.arm), *clock, *OPTIONS.get(driver, ()))
    supply = ("--listen", f"127.0.0.1:{scpi}", "--recording", str(day.supply), *clock)
    async with (
        EmulatorProcess(driver, *arm),
        EmulatorProcess("scpi_analyzer", *supply),
        running(folder, text) as (daemon, audience),
    ):
        await audience.until(powered_off, day.seconds + 60)
        assert not audience.unbalanced
        assert await daemon.stop() == 0
    return epoch


def cellwatt(*words: str | Path) -> str:
    command = [sys.executable, "-m", "cellwatt.commands", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def split(folder: Path, robot: Path, day: Day, epoch: float) -> dict:
    """What is cut from the recording, through `disaggregate`: what is in energy.json."""
    arm, out = Arm.load(robot), folder / "campaign"
    recording = Recording.open(folder / "record")

    def at(begin: float, end: float) -> Recording:
        return recording.between(round((epoch + begin) * 1e9), round((epoch + end) * 1e9))

    for name, span in day.states.items():
        cut_state(power_of(at(*span)), out / f"{name}.parquet")
    for payload, span in day.programmes.items():
        recorded = motion_of(at(*span), arm), power_of(at(*span))
        runs = cut_programme(arm, *recorded, payload, SPEEDS, REPETITIONS, LEAST, out)
        assert all(run.written for run in runs), runs
    files = [word for name in day.states for word in (f"--{name}", out / f"{name}.parquet")]
    given = ["--robot", robot, *files, "--runs", out / "runs", "--out", folder / "report"]
    return json.loads(cellwatt("disaggregate", *given, "--json"))


def errors(plant, found: dict) -> dict[str, float]:
    """Worst of all runs: groups and regeneration in percent of the run's energy, ε in points, fixed powers in W."""
    worst = dict.fromkeys((*MEASURED, "regeneration", "epsilon", "fixed"), 0.0)
    for run in found["runs"]:
        true = plant.truth(run["speed_mm_s"], run["payload_kg"])
        for name in MEASURED:
            worst[name] = max(worst[name], 100 * abs(run[name] - true[name]) / true["total"])
        if run["regeneration"] is None:
            assert run["notes"], "a split that is refused says why"
        else:
            off = 100 * abs(run["regeneration"] - true["regeneration"]) / true["total"]
            worst["regeneration"] = max(worst["regeneration"], off)
        true_share = 100 * true["positive_mechanical"] / true["total"]
        worst["epsilon"] = max(worst["epsilon"], abs(run["motion_efficiency_percent"] - true_share))
    for speed, said in found["payload_efficiency_percent"].items():
        empty, loaded = (plant.truth(float(speed), p)["total"] for p in (0.0, plant.cube.payload))
        worst["epsilon"] = max(worst["epsilon"], abs(said - 100 * (loaded - empty) / loaded))
    made = plant.made
    powers = {"controller": made.controller, "robot_electronics": made.electronics, "brakes": made.brakes}
    worst["fixed"] = max(abs(found["fixed"][name] - watt) for name, watt in powers.items())
    return worst


@pytest.mark.parametrize("robot", list(DEVICES))
async def test_what_the_emulated_arm_truly_spent(robot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCH))
    from tests.plugins.energy.procedure import plant as plants

    plant = plants.Arm(plants.ROBOTS[robot])
    described = plant.describe(tmp_path / "robot")
    day = write_day(tmp_path, plant)
    epoch = await record(tmp_path, day, robot)
    worst = errors(plant, split(tmp_path, described, day, epoch))
    print(robot, {name: round(value, 3) for name, value in worst.items()})
    assert max(worst[name] for name in (*MEASURED, "regeneration")) < 1.0, worst
    assert worst["epsilon"] < 0.3, worst
    assert worst["fixed"] < 0.2, worst
