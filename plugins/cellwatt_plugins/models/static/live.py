"""The running side of a collection: frames from the cell's bus into the file of poses."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.config import load
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.reach import link_to
from cellwatt.subscriber import Subscriber
from cellwatt.tables import read_table
from cellwatt_plugins.models.static.collect import Collector, Progress, place_of

Float = NDArray[np.float64]

_TURN: float = 0.5  # s, between two looks at the clock


def collect(
    cell: Path,
    source: str | None,
    out: Path,
    plan: Float | None,
    seconds: float | None,
    tell: Callable[[Progress], None],
) -> Progress | None:
    """Collect until all of the ``plan`` was held, or ``seconds`` are over; ``tell`` is called after each pose.

    None where not one frame came. Raises ``ConfigError``, ``OutletError`` and ``RecordingError``.
    """
    config = load(cell)
    link = link_to(config)
    end = np.inf if seconds is None else time.monotonic() + seconds
    collector: Collector | None = None
    with Subscriber(config.site, config.cell, link, want=("frame",), resume=place_of(out)) as subscriber:
        while time.monotonic() < end:
            try:
                message = subscriber.receive(_TURN)
            except TimeoutError:
                continue
            frames = message.content
            if not isinstance(frames, Frames):
                continue
            if collector is None:
                collector = Collector(frames.layout, source, out, plan)
                tell(collector.progress)
            held = list(collector.take(frames))
            if held:
                # After all of them: a place kept earlier would leave the later ones out of what is asked for again.
                collector.file.keep_place(subscriber.positions)
            for progress in held:
                tell(progress)
                if progress.total and progress.planned == progress.total:
                    return progress
    return None if collector is None else collector.progress


def read_plan(path: Path) -> Float:
    """The poses (P, n) rad of a plan's table. Raises ``RecordingError``."""
    table = read_table(path)
    poses = table.joints("position")
    if poses is None:
        raise table.lacks("q_1")
    return poses
