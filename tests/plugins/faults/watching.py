"""Runs the segment and faults stages over frames, as the daemon does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from _pytest.mark import ParameterSet
from click.testing import CliRunner, Result

from cellwatt.emulation import ArmSignals
from cellwatt.frames import Frames
from cellwatt.stage import CellInfo
from cellwatt.tables import write_table
from cellwatt_plugins.faults.api import learn_from
from cellwatt_plugins.faults.on_reference import ReferenceStage
from cellwatt_plugins.faults.stage import FaultsStage
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.plugins.faults.plant import frames


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
    learn_from(list(blocks), robot, "arm", "supply.power").save(path)
    return path


def watch(reference: Path, blocks: Sequence[Frames], kind: type[ReferenceStage] = FaultsStage, **settings):
    """Every alarm message of a stage of this kind for these frames, in order."""
    cell, layout = CellInfo("plant", "cell", None, reference.parent), blocks[0].layout
    segment = SegmentStage("segment", SegmentSettings(), layout, cell)
    stage = kind("faults", kind.Settings(reference=Path(reference.name), **settings), layout, cell)
    return [*(alarm for block in blocks for alarm in stage.process(block, segment.process(block, ()))), *stage.close()]


def write_recording(path: Path, time: np.ndarray, position: np.ndarray, power: np.ndarray) -> Path:
    """A table with t, q_1 … q_n and power."""
    joints = {f"q_{joint}": column for joint, column in enumerate(position.T, start=1)}
    write_table(path, {"t": time, **joints, "power": power})
    return path


def arm_frames(signals: ArmSignals, seconds: float, lead: float = 0.0) -> list[Frames]:
    """Positions and supply power of the emulated arm of the demo at 50 Hz, after ``lead`` s at rest."""
    told = signals.at(np.maximum(np.arange(round((lead + seconds) * 50)) / 50 - lead, 0.0))
    positions = np.column_stack([told[f"joint_{joint}.position"] for joint in range(1, 7)])
    return frames(positions, told["supply.power"], block=10)


def called(command: click.Command, *arguments: object) -> Result:
    """What a command does with these words."""
    return CliRunner().invoke(command, [str(argument) for argument in arguments])
