"""Frames of all sources, with numbers that continue when the settings change."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from cellwatt.align import Aligner
from cellwatt.batch import Batch, Tick
from cellwatt.channel import Stream
from cellwatt.config import FrameSettings
from cellwatt.frames import Frames, cut


class Framer:
    """An aligner, replaced when the settings change; frames are numbered from ``sequence`` throughout.

    No time is emitted twice, and frames up to time ``after``, ns, were emitted before.
    """

    def __init__(
        self, streams: Mapping[str, tuple[Stream, ...]], settings: FrameSettings, sequence: int = 0, after: int = 0
    ) -> None:
        self.sequence = sequence
        self._after = after
        self._aligner = Aligner(streams, settings.rate, settings.latency)

    def take(self, entry: Batch | Tick) -> Iterator[Frames]:
        """The frames that a batch or tick settles."""
        return self._numbered(self._aligner.tick(entry) if isinstance(entry, Tick) else self._aligner.add(entry))

    def flush(self) -> Iterator[Frames]:
        """The frames up to the newest sample, at the end of the data."""
        return self._numbered(self._aligner.flush())

    def change(self, streams: Mapping[str, tuple[Stream, ...]], settings: FrameSettings) -> None:
        """Restart with other streams or another grid."""
        self._aligner = Aligner(streams, settings.rate, settings.latency)

    def status(self) -> dict[str, Any]:
        """Counts of emitted frames, of samples that missed theirs by stream, and of skipped frames; JSON-ready."""
        counts = self._aligner.counts.items()
        streams = {f"{source}/{stream}": asdict(found) for (source, stream), found in counts}
        return {"count": self.sequence, "streams": streams | {"cell": {"skipped": self._aligner.skipped}}}

    def _numbered(self, blocks: Iterable[Frames]) -> Iterator[Frames]:
        for block in blocks:
            given = int(np.searchsorted(block.time, self._after, side="right"))
            if given == len(block):
                continue
            frames = replace(cut(block, given, len(block)), sequence=self.sequence)
            self.sequence, self._after = self.sequence + len(frames), int(frames.time[-1])
            yield frames
