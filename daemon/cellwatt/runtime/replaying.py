"""A recording run through the same aligner and stages as live data."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

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
    """The frames that these entries made, or would make with other settings of the grid."""
    aligner = Aligner(streams, settings.rate, settings.latency)
    for entry in entries:
        yield from aligner.tick(entry) if isinstance(entry, Tick) else aligner.add(entry)
    yield from aligner.flush()


def run_stages(frames: Iterable[Frames], chains: list[Chain]) -> Iterator[Frames | Result]:
    """Each block of frames followed by the results it gave; at the end what the chains still held."""
    for block in frames:
        yield block
        for chain in chains:
            yield from chain.process(block)
    yield from itertools.chain.from_iterable(chain.close() for chain in chains)


@dataclass(slots=True)
class Comparison:
    """Frames of a replay held against those that were recorded, by time of the grid point.

    ``equal`` counts points that agree in every bit of values, quality and bounds; ``first_difference`` is the
    time, ns, of the earliest that does not. ``only_recorded`` and ``only_replayed`` were in one of the two.
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
    """Hold two runs of frames against each other, bit by bit."""
    ours, theirs = _rows(recorded), _rows(replayed)
    found = Comparison(only_recorded=len(ours.keys() - theirs.keys()), only_replayed=len(theirs.keys() - ours.keys()))
    for at in sorted(ours.keys() & theirs.keys()):
        if ours[at] == theirs[at]:
            found.equal += 1
        else:
            found.different += 1
            if found.first_difference is None:
                found.first_difference = at
    return found


def _rows(blocks: Iterable[Frames]) -> dict[int, bytes]:
    rows: dict[int, bytes] = {}
    for block in blocks:
        for i, at in enumerate(block.time.tolist()):
            parts = (block.values[i], block.quality[i], block.bound[i])
            rows[at] = b"".join(np.ascontiguousarray(p).tobytes() for p in parts)
    return rows
