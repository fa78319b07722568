"""Screens and clocks of the tests."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

from cellwatt.progress import Work


class Clock:
    """A clock that only moves when it is told to."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


class Noting:
    """Notes when it is asked to show and to clear."""

    def __init__(self):
        self.calls = []

    def begin(self, work: Work) -> None:
        self.calls.append("begin")

    def end(self) -> None:
        self.calls.append("end")

    def aside(self) -> AbstractContextManager[None]:
        self.calls.append("aside")
        return nullcontext()
