"""The main job on real input: recordings of real arms, served at their own pace, arrive as they are in the file.

The real ones (a UR10e and a UR3e) are read where they lie beside the checkout; a made one stands in everywhere.
"""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import numpy as np
import pytest

from cellwatt.batch import Batch
from cellwatt.emulation import ArmSignals, EmulatorProcess, RecordedSignals, load_signals
from tests.patience import PATIENCE
from tests.system.running import Audience, running

pytestmark = [pytest.mark.system, pytest.mark.timeout(420)]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
VECTORS = ("actual_q", "actual_qd", "actual_current", "target_current", "target_moment")
UR10E = {
    "points": ("validation_data/ur-20_01_17-ptp_10_points.csv", 700, 2700),
    "excitation": ("identification_data/ur-20_02_05-20sec_8harm.csv", 320, 1820),
}
UR3E = ("L0L1", "L1L2", "L2L3", "L3L4", "L4L5")


def write_rtde(path: Path, stamps: np.ndarray, table: np.ndarray, vectors: tuple[str, ...]) -> Path:
    """A recording in RTDE's own column names."""
    names = ["timestamp", *(f"{v}_{i}" for v in vectors for i in range(6))]
    rows = np.column_stack([stamps, table])
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n")
    return path


def made(folder: Path) -> Path:
    """Twelve seconds of an arm that we made up, at an uneven rate near 100 Hz like the real recording."""
    rng = np.random.default_rng(3)
    stamps = 512.5 + np.cumsum(rng.choice([0.008, 0.01, 0.012], size=1200, p=[0.1, 0.8, 0.1]))
    signals = ArmSignals(seed=4).at(stamps - stamps[0])
    kinds = ("position", "velocity", "current", "current", "torque")
    table = np.column_stack([signals[f"joint_{i}.{k}"] for k in kinds for i in range(1, 7)])
    return write_rtde(folder / "made.csv", stamps, table, VECTORS)


def ur10e(name: str, folder: Path) -> Path:
    file, first, last = UR10E[name]
    matches = sorted((DATA / "ur10e").glob(file.replace(".csv", "*.csv")))
    if not matches:
        pytest.skip(f"the recording {file} is not beside this checkout")
    table = np.genfromtxt(matches[0], delimiter=",")[first:last]
    return write_rtde(folder / "ur10e.csv", table[:, 0], table[:, 1:31], VECTORS)


def ur3e(name: str, _: Path) -> Path:
    path = DATA / "ur3e_power" / f"{name}.csv"
    if not path.is_file():
        pytest.skip(f"the recording {path.name} is not beside this checkout")
    return path


CASES = {
    "made": (made, VECTORS),
    **{f"ur10e-{n}": (lambda folder, n=n: ur10e(n, folder), VECTORS) for n in UR10E},
    **{
        f"ur3e-{n}": (lambda folder, n=n: ur3e(n, folder), (*VECTORS, "actual_robot_voltage", "actual_robot_current"))
        for n in UR3E
    },
}


LONG, WAITED = 20.0, 72.0
"""s of a recording within which clocks are compared, and that the arm may have kept us waiting before a shorter one."""


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
async def test_what_arrives_is_what_is_in_the_file(tmp_path: Path, case: str) -> None:
    find, fields = CASES[case]
    path = await asyncio.to_thread(find, tmp_path)
    truth = load_signals(path)
    for lead in (8.0, 24.0, 72.0):  # s that a machine may need to start a daemon
        (folder := tmp_path / f"{lead:.0f}").mkdir()
        if heard := await played(folder, path, truth, fields, lead):
            break
    else:
        pytest.fail("the daemon never came up in time")
    epoch, audience = heard
    got = audience.batches["raw/arm/rtde"]
    assert_same_values(got, truth.columns, fields)
    device_time = np.concatenate([b.device_time for b in got if b.device_time is not None])
    np.testing.assert_allclose(device_time * 1e-9, truth.time, rtol=0, atol=1e-6)
    assert_times_hold(got, epoch + truth.time - truth.time[0])
    assert not audience.gaps


def connected(audience: Audience) -> bool:
    """Whether the arm answers; before it begins it sends nothing."""
    source = audience.source("arm")
    return bool(source) and bool(source["identity"] or source["counters"].get("event stream stopped"))


async def played(
    folder: Path, path: Path, truth: RecordedSignals, fields: tuple[str, ...], lead: float
) -> tuple[float, Audience] | None:
    """An arm that begins in ``lead`` s, and what is heard of it; nothing where its daemon came up later than that."""
    epoch = time.time() + lead
    options = ("--option", "start=epoch", "--epoch", str(epoch), "--recording", str(path))
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0", *options) as device:
        host, port = device.address.split(":")
        settings = f"host: {host}, port: {port}, rate: {1 / np.median(np.diff(truth.time)):.0f} Hz"
        settings += f", timeout: {2 * lead} s, channels: [{', '.join(fields)}]"
        text = f"sources:\n  arm: {{driver: ur, {settings}}}\nstages: {{segment: {{}}}}\n"
        async with running(folder, text) as (daemon, audience):
            await audience.until(connected)
            if time.time() > epoch:
                return None
            await audience.until(
                lambda a: a.received["raw/arm/rtde"] >= len(truth.time), lead + truth.length + PATIENCE
            )
            assert await daemon.stop() == 0
    return epoch, audience


def assert_same_values(got: list[Batch], columns: dict[str, np.ndarray], fields: tuple[str, ...]) -> None:
    values = np.concatenate([b.values for b in got])
    expected = [columns[n] for f in fields for n in ((f,) if f in columns else [f"{f}_{i}" for i in range(6)])]
    np.testing.assert_array_equal(values, np.column_stack(expected))


def assert_times_hold(got: list[Batch], truth: np.ndarray) -> None:
    """The emulator sends a row at its time or a little later, never earlier: the bound must hold that moment."""
    stamped = np.concatenate([b.time for b in got]) * 1e-9
    bound = np.concatenate([b.bound for b in got]) * 1e-9
    inside = np.abs(stamped - truth) <= bound + 2e-6
    assert inside.mean() >= 0.999, f"{(~inside).sum()} of {len(inside)}, worst {np.abs(stamped - truth).max()} s"
    # The arm keeps its first package back until it begins; comparisons of the clocks, some 10 s apart, make up for it.
    assert bound[-1] < (0.1 if truth[-1] - truth[0] > LONG else WAITED)
