"""Runs the segment and faults stages over frames, as the daemon does."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from _pytest.mark import ParameterSet

from cellwatt.frames import Frames
from cellwatt.results import Alarm
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.api import learn_from
from cellwatt_plugins.faults.reference import save
from cellwatt_plugins.faults.stage import FaultsSettings, FaultsStage
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.plugins.faults.plant import START


def more(*values: Any) -> list[ParameterSet]:
    """Parameters that are among the slow tests only; a tuple stands for several arguments."""
    rows = (value if isinstance(value, tuple) else (value,) for value in values)
    return [pytest.param(*row, marks=pytest.mark.slow) for row in rows]


def beside_another_arm(table: Frames) -> Frames:
    """Frames of a table and of another arm, which stands still."""
    other = tuple(replace(c, name=c.name.replace("table", "arm_2")) for c in table.layout.channels[:-1])
    layout = replace(table.layout, channels=other + table.layout.channels)
    return replace(table, layout=layout, values=np.hstack([np.zeros((len(table), len(other))), table.values]))


def learned(path: Path, blocks: Iterable[Frames], robot: str | None = None) -> Path:
    """The reference of healthy frames as a file."""
    reference, _ = learn_from(blocks, robot, "arm", "supply.power")
    save(reference, path)
    return path


def watch(reference: Path, blocks: Iterable[Frames], **settings) -> list[Alarm]:
    """Every alarm message for these frames, in order."""
    cell = CellInfo("plant", "cell", None, reference.parent)
    segment = faults = None
    alarms: list[Alarm] = []
    for frames in blocks:
        if segment is None:
            segment = SegmentStage("segment", SegmentSettings(), frames.layout, cell)
            chosen = FaultsSettings(reference=Path(reference.name), **settings)
            faults = FaultsStage("faults", chosen, frames.layout, cell)
        alarms += faults.process(frames, segment.process(frames, ()))
    return alarms


def raised(alarms: Iterable[Alarm]) -> list[Alarm]:
    """The first message of each alarm."""
    first: dict[tuple[str, int], Alarm] = {}
    for alarm in alarms:
        if alarm.active:
            first.setdefault((alarm.id, alarm.since), alarm)
    return list(first.values())


def since_start(time: int) -> float:
    """ns as s from the start of the plant's time."""
    return (time - START) * 1e-9
