"""Meaning of the values of slow power meters, as far as the motion that ``cellwatt doctor`` saw tells it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain

from cellwatt.batch import Batch
from cellwatt.config import CellConfig
from cellwatt.errors import CellwattError
from cellwatt.registry import stage as find_stage
from cellwatt.results import Alarm
from cellwatt.runtime.assemble import layout_of
from cellwatt.runtime.examine import Examination
from cellwatt.runtime.replaying import replay_frames
from cellwatt.stage import CellInfo

STAGE = "meter"
"""The stage that finds it."""


def examine_meters(config: CellConfig, found: Sequence[Examination], read: Mapping[str, Sequence[Batch]]) -> None:
    """Add to the findings of each source with a slow meter what its values stand for, as the stage says.

    The settings are those of the cell's own stage, where it has one. A cell without a slow meter or an arm has nothing
    to be found.
    """
    streams = {name: tuple({b.stream.name: b.stream for b in batches}.values()) for name, batches in read.items()}
    settings = next((s.settings for s in config.stages.values() if s.kind == STAGE), None)
    try:
        kind = find_stage(STAGE)
        layout = layout_of(streams, config.frames)
        cell = CellInfo(config.site, config.cell, config.robot, config.folder)
        stage = kind(STAGE, settings or kind.Settings(), layout, cell)
    except CellwattError:
        return
    entries = sorted(chain.from_iterable(read.values()), key=lambda batch: batch.arrival)
    said = [r for frames in replay_frames(entries, streams, config.frames) for r in stage.process(frames, ())]
    for alarm in (r for r in [*said, *stage.close()] if isinstance(r, Alarm)):
        source = next(e for e in found if e.name == alarm.source)
        source.findings.append(alarm.statement)
        if alarm.severity != "info" and source.verdict == "ok":
            source.verdict = "warning"
