"""What ``cellwatt doctor`` says of a slow power meter, from what it read of an arm and of the meter."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellwatt import Batch, Channel, Stream
from cellwatt.config import load
from cellwatt.runtime.examine import Examination, examine_meters
from tests.plugins.robot.slow_meter import measured
from tests.plugins.robot.test_meter import Arm

EPOCH = 1_700_000_000_000_000_000
WINDOW, LATE = 0.1, 0.15
JOINTS = tuple(
    Channel(f"joint_{j}.{what}", unit) for what, unit in (("position", "rad"), ("torque", "Nm")) for j in (1, 2)
)


def batches(source: str, stream: Stream, time: np.ndarray, values: np.ndarray) -> list[Batch]:
    """Samples (n, channels) at ``time`` (n,) s, each in a batch of its own."""
    made = []
    for i, (at, row) in enumerate(zip(time, values, strict=True)):
        when = np.array([EPOCH + round(at * 1e9)])
        quality = np.zeros(1, np.uint8)
        made.append(Batch(source, stream, i, int(when[0]) + 1_000_000, when, when * 0 + 500_000, row[None], quality))
    return made


def read(declared: float) -> dict[str, list[Batch]]:
    arm = Arm(40.0, 5)
    time = np.arange(0, arm.time[-1], 0.02)
    ends = np.arange(0.33, arm.time[-1] - LATE, WINDOW)
    means = measured(arm.time, arm.power, ends - WINDOW, ends)
    power = Channel("supply.power", "W", window=declared)
    return {
        "arm": batches("arm", Stream("state", JOINTS, 50.0, "host"), time, arm.joints(time)),
        "mains": batches("mains", Stream("measured", (power,), 10.0, "host"), ends + LATE, means[:, None]),
    }


@pytest.fixture
def config(tmp_path: Path):
    file = tmp_path / "weld.yaml"
    file.write_text(
        "site: plant\ncell: weld\nsources:\n"
        "  arm: {driver: ur, host: 192.0.2.1}\n  mains: {driver: scpi_analyzer, host: 192.0.2.2}\n"
    )
    return load(file, {})


def findings(config, seen: dict[str, list[Batch]]) -> dict[str, Examination]:
    found = [Examination(name, "", "ok") for name in seen]
    examine_meters(config, found, seen)
    return {each.name: each for each in found}


def test_window_and_delay_are_told_beside_the_meter(config):
    found = findings(config, read(WINDOW))
    (text,) = found["mains"].findings
    assert text.startswith("mains.supply.power is averaged over 10")
    assert "a value every 100 ms" in text
    assert (found["mains"].verdict, found["arm"].findings) == ("ok", [])
