"""The cell of the tests with a record on disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cellwatt import Batch, Frames
from cellwatt.record import History
from cellwatt.results import Event, Result
from tests.daemon.outlets.zenoh.fake_cell import FakeView


class RecordedView(FakeView):
    """A ``CellView`` whose past is a ``history``."""

    def __init__(self, history: History, session: int) -> None:
        super().__init__(session)
        self._history = history

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        return self._history.recordings()

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        return self._history.history(source, stream, session, first, count)

    def frame_history(self, session: int, first: int, count: int) -> Sequence[Frames]:
        return self._history.frames(session, first, count)

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        return self._history.results(series, session, first, count)
