"""A spring on an elbow: its alarm's pack outlives the record. And a folder is read while its cell rotates files."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import cellwatt as cw
from cellwatt.demo.fault import JOINT
from cellwatt.record import packs
from tests.patience import PATIENCE, eventually
from tests.system.running import Audience, Daemon, hook_spring, judged_arm

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

BEFORE, AFTER = 8.0, 1.0


@pytest.mark.slow
@pytest.mark.blocks_loop  # it reads a whole pack when the daemon has ended
async def test_the_minutes_before_an_alarm_are_kept_when_the_record_has_forgotten_them(tmp_path: Path) -> None:
    epoch = time.time()
    async with judged_arm(epoch) as (devices, text):
        record = f"keep: 12 MB, evidence: {{before: {BEFORE} s, after: {AFTER} s}}"
        async with Daemon(tmp_path, text, record=record) as daemon, Audience(daemon) as audience:
            await audience.until(lambda a: a.all_up() and a.received["raw/arm/rtde"] > 4000)
            await hook_spring(devices, epoch, 2)
            await audience.until(
                lambda a: any(e.kind == "evidence" and e.data["alarms"] for e in a.events), 2 * PATIENCE
            )
            told = next(e for e in audience.events if e.kind == "evidence")
            pack = tmp_path / "record" / packs.FOLDER / told.data["pack"]
            alarm = next(a for a in audience.alarms if a.id == told.data["alarms"][0])
            await audience.until(lambda a: (a.status.get("evidence") or {}).get("packs", 0) >= 1)
            await eventually(
                lambda: cw.open(tmp_path / "record").start > alarm.time, "the record to forget it", 2 * PATIENCE
            )
            assert await daemon.stop() == 0
    assert alarm.joint == JOINT and alarm.kind.endswith("_fault")
    with cw.open(pack) as kept:
        assert kept.start <= alarm.since - 0.9 * BEFORE * 1e9 and kept.end >= alarm.time + 0.9 * AFTER * 1e9
        assert alarm in kept.alarms() and list(kept.health()) and list(kept.frames()) and kept.intervals()
        samples = kept.batches("arm", "rtde")
        assert np.all(np.diff(samples.sequence) == 1) and len(samples) > 450 * (BEFORE + AFTER)
        assert not kept.damage
    page = packs.page_of(pack).read_text()
    assert f"Joint {JOINT}" in page and alarm.statement.split(":")[0] in page and "<svg" in page
