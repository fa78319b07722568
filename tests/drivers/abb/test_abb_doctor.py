"""What ``cellwatt doctor`` says of a controller."""

from __future__ import annotations

import pytest

from cellwatt.config import SourceConfig
from cellwatt.runtime import examine as examining
from cellwatt.runtime.examine import Examination, examine
from cellwatt_drivers.abb import AbbDriver, AbbSettings

from .rig import emulated


@pytest.fixture(autouse=True)
def _installed(monkeypatch):
    """Entry points are read from files, which a loop is not held up for."""
    monkeypatch.setattr(examining, "find_driver", lambda name: AbbDriver)


async def look(place: dict[str, object], seconds: float = 0.6, **changes: object) -> Examination:
    settings = AbbSettings.model_validate(place | {"web_rate": "10 Hz"} | changes)
    return await examine(SourceConfig("arm", "abb", settings), seconds, 5.0)


async def test_a_clock_that_is_not_known_yet_is_a_warning(monkeypatch):
    """In the first seconds of a connection the bound is seconds."""
    monkeypatch.setattr(examining, "SETTLING", 0.0)
    async with emulated(robotware="6") as (_, place):
        found = await look(place, robotware=6)
    assert found.verdict == "warning"
    assert any(f.startswith("egm: its time stamps may be wrong by ") for f in found.findings)
    assert not any("move_index" in f for f in found.findings)  # RobotWare 6 has none


async def test_energy_that_the_controller_calls_not_valid():
    async with emulated() as (emulator, place):
        emulator.epoch += 3600.0  # nothing measured yet
        found = await look(place, egm=[])
    assert found.verdict == "warning"
    assert any("reports its energy measurement as not valid (not-paused)" in f for f in found.findings)
    assert any(f.startswith("no values: controller.energy") for f in found.findings)
