"""A cell without a daemon: it records frames with known values, and is the ``CellView`` of an outlet."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from cellwatt.alarms import AlarmBook
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.outlet import Journal
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import FileName, Header
from cellwatt.record.openfile import OpenFile
from cellwatt.results import Alarm

LAYOUT: Final = Layout(
    (
        FrameChannel("arm.joint_1.position", "rad", "continuous", "linear"),
        FrameChannel("arm.supply.power", "W", "continuous", "average"),
    ),
    50.0,
)


class RecordedCell:
    """A ``CellView`` of ten minutes ago; frame n has the values n and 10 n, and the time of its grid point."""

    def __init__(self, folder: Path, site: str = "plant-1", cell: str = "weld-3") -> None:
        self.site, self.cell, self.folder = site, cell, folder
        self.record_folder: Path | None = folder
        self.journal: Journal | None = None
        self.alarms = AlarmBook()
        self.session = (time.time_ns() // 10**9 - 600) * 10**9
        self.made = 0
        self._file = OpenFile(folder / str(FileName(self.session, 1, cell)), Header(site, cell, self.session, number=1))
        self._encoder = Encoder(self._file)

    def frames(self, count: int) -> Frames:
        """Make and record the next frames."""
        n = np.arange(self.made, self.made + count)
        self.made += count
        values = n[:, None] * np.array([1.0, 10.0])
        at = self.session + (n + 1) * LAYOUT.step
        zero = np.zeros(values.shape)
        made = Frames(LAYOUT, int(n[0]), at, values, zero.astype(np.uint8), zero.astype(np.int64))
        self._encoder.add(made)
        self._file.write_chunk()
        return made

    def alarm(self, name: str) -> Alarm:
        """Raise and record an alarm now."""
        at = self.session + self.made * LAYOUT.step
        made = Alarm(name, "joint_fault", "error", True, at, at, f"{name} is up.")
        self._encoder.add(made)
        self._file.write_chunk()
        return made

    def close(self) -> None:
        """Release the recording without finishing it, as a crash does."""
        self._file.release()

    def status(self) -> Mapping[str, Any]:
        """See ``CellView``."""
        return {"state": "green", "alarms": [], "site": self.site, "cell": self.cell}

    def config(self) -> Mapping[str, Any]:
        """See ``CellView``."""
        return {"record": {"folder": str(self.folder), "frames": True}}

    def schema(self) -> Mapping[str, Any]:
        """See ``CellView``."""
        return {}

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        """See ``CellView``."""
        return []

    def history(self, *_: Any) -> Sequence[Any]:
        """See ``CellView``: nothing is in memory."""
        return []

    frame_history = result_history = history

    def acknowledge(self, *_: Any) -> None:
        """See ``CellView``."""

    shelve = unshelve = acknowledge
