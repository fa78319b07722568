"""Runs a recording through the same aligner and stages as live data."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from cellwatt.align import Aligner
from cellwatt.batch import Batch, Tick
from cellwatt.channel import Stream
from cellwatt.config import FrameSettings
from cellwatt.frames import Frames
from cellwatt.results import Result
from cellwatt.runtime.chain import Chain

Entry = Batch | Tick


def replay_frames(
    entries: Iterable[Entry], streams: Mapping[str, tuple[Stream, ...]], settings: FrameSettings
) -> Iterator[Frames]:
    """Align recorded entries to frames again, by the same or other settings of the grid."""
    aligner = Aligner(streams, settings.rate, settings.latency)
    for entry in entries:
        yield from aligner.add(entry)
    yield from aligner.flush()


def run_stages(frames: Iterable[Frames], chains: list[Chain]) -> Iterator[Frames | Result]:
    """Yield each block of frames and its results; at the end the results that the chains still hold."""
    for block in frames:
        yield block
        for chain in chains:
            yield from chain.process(block)
    yield from itertools.chain.from_iterable(chain.close() for chain in chains)


@dataclass(slots=True)
class Comparison:
    """Comparison of the frames of a replay with the recorded ones, by time of the grid point.

    ``equal`` counts points that agree in every bit of values, quality and bounds; ``first_difference`` is the
    time, ns, of the earliest that does not. ``only_recorded`` and ``only_replayed`` count points in one of the two.
    """

    equal: int = 0
    different: int = 0
    only_recorded: int = 0
    only_replayed: int = 0
    first_difference: int | None = None

    @property
    def identical(self) -> bool:
        """True if every frame is in both and equal."""
        return not (self.different or self.only_recorded or self.only_replayed)


def compare(recorded: Iterable[Frames], replayed: Iterable[Frames]) -> Comparison:
    """Compare two runs of frames bit by bit, block by block as they come, each in the order of time."""
    found = Comparison()
    merged = heapq.merge(_rows(recorded, "recorded"), _rows(replayed, "replayed"), key=itemgetter(0))
    for at, same in itertools.groupby(merged, key=itemgetter(0)):
        rows = {run: row for _, run, row in same}
        if len(rows) == 1:
            found.only_recorded += "recorded" in rows
            found.only_replayed += "replayed" in rows
        elif rows["recorded"] == rows["replayed"]:
            found.equal += 1
        else:
            found.different += 1
            found.first_difference = at if found.first_difference is None else found.first_difference
    return found


def _rows(blocks: Iterable[Frames], run: str) -> Iterator[tuple[int, str, bytes]]:
    """Time, ``run`` and bits of each frame."""
    for block in blocks:
        for i, at in enumerate(block.time.tolist()):
            parts = (block.values[i], block.quality[i], block.bound[i])
            yield at, run, b"".join(np.ascontiguousarray(p).tobytes() for p in parts)
