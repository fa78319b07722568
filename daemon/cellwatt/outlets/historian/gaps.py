"""Spans of time that are still to be filled in. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

MOST: Final = 256
"""Spans that are remembered apart; beyond that the nearest two become one."""
Span = tuple[int, int]
"""After ``start`` up to ``end``, UTC ns."""


class Gaps:
    """Disjoint spans in order."""

    def __init__(self, spans: Iterable[Span] = ()) -> None:
        self._spans: list[Span] = []
        for start, end in spans:
            self.add(start, end)

    def __iter__(self) -> Iterator[Span]:
        return iter(tuple(self._spans))

    def __bool__(self) -> bool:
        return bool(self._spans)

    @property
    def length(self) -> int:
        """Sum of all spans, ns."""
        return sum(end - start for start, end in self._spans)

    def add(self, start: int, end: int) -> None:
        """Add a span; what touches it becomes one with it."""
        if end <= start:
            return
        apart = [s for s in self._spans if s[1] < start or s[0] > end]
        touching = [s for s in self._spans if not (s[1] < start or s[0] > end)]
        joined = min([start, *(s[0] for s in touching)]), max([end, *(s[1] for s in touching)])
        self._spans = sorted([*apart, joined])
        while len(self._spans) > MOST:
            at = min(range(len(self._spans) - 1), key=lambda i: self._spans[i + 1][0] - self._spans[i][1])
            self._spans[at : at + 2] = [(self._spans[at][0], self._spans[at + 1][1])]

    def first(self, longest: int, before: int) -> Span | None:
        """The oldest part, at most ``longest`` ns, that ends at or before ``before``; ``None`` where there is none."""
        for start, end in self._spans:
            end = min(end, start + longest)
            return (start, end) if end <= before else None
        return None

    def remove(self, start: int, end: int) -> None:
        """Take away what is filled in."""
        if end <= start:
            return
        kept = [part for s in self._spans for part in ((s[0], min(s[1], start)), (max(s[0], end), s[1]))]
        self._spans = [(first, last) for first, last in kept if first < last]
