"""Stages of work inside one another, and how far they are.

The one that listens is a context variable, not a parameter: the loops that take long lie ten calls below a command, in
functions that have nothing else to do with a terminal, and the daemon calls the same ones with nobody there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol, TypeVar

T = TypeVar("T")


@dataclass(eq=False)
class Stage:
    """A part of the work: ``done`` of ``total``, in any unit; a stage inside it does ``share`` of its outer one's."""

    name: str
    total: float | None = None
    share: float = 1.0
    done: float = 0.0
    began: float = 0.0

    def advance(self, amount: float = 1.0, name: str | None = None) -> None:
        """Count what was done since the last call; from now on the stage is called ``name``."""
        self.done += amount
        self.name = self.name if name is None else name


@dataclass(frozen=True)
class Told:
    """State of the work as it is shown."""

    text: str
    fraction: float | None
    """Of the outermost stage; None where its total is not known."""
    left: float | None
    """s until that stage ends, if it goes on as it did."""


class Screen(Protocol):
    """Place where work is shown."""

    def begin(self, work: Work) -> None:
        """Show the work from now on: a stage has begun."""

    def end(self) -> None:
        """Clear what is shown: no stage is left."""

    def aside(self) -> AbstractContextManager[None]:
        """Clear what is shown, until output of another kind is written."""


class Work:
    """The stages that are open, outermost first; ``screen`` is told when the first begins and the last has ended."""

    def __init__(self, screen: Screen, clock: Callable[[], float] = time.monotonic) -> None:
        self.screen = screen
        self.clock = clock
        self._open: tuple[Stage, ...] = ()  # replaced, not changed: the screen reads it from a thread of its own

    def enter(self, stage: Stage) -> None:
        """Begin a stage inside the ones that are open."""
        stage.began = self.clock()
        self._open = (*self._open, stage)
        if len(self._open) == 1:
            self.screen.begin(self)

    def leave(self, stage: Stage, outer: Stage | None, before: float) -> None:
        """End a stage and what was left open inside it; ``outer`` had done ``before`` when it began."""
        if stage not in self._open:
            return
        if outer is not None:
            outer.done = before + stage.share
        self._open = self._open[: self._open.index(stage)]
        if not self._open:
            self.screen.end()

    @property
    def innermost(self) -> Stage | None:
        """The stage that began last."""
        return self._open[-1] if self._open else None

    def told(self) -> Told | None:
        """State of the work now; None where no stage is open."""
        stages = self._open
        if not stages:
            return None
        inside, fraction = 0.0, None
        for stage in reversed(stages):
            fraction = min((stage.done + inside) / stage.total, 1.0) if stage.total else None
            inside = stage.share * (fraction or 0.0)
        left = (self.clock() - stages[0].began) * (1 / fraction - 1) if fraction else None
        return Told(", ".join(stage.name for stage in stages if stage.name), fraction, left)


_LISTENING: ContextVar[Work | None] = ContextVar("listening", default=None)


@contextmanager
def listening(work: Work) -> Iterator[Work]:
    """Let ``work`` take the stages that are begun inside."""
    token = _LISTENING.set(work)
    try:
        yield work
    finally:
        _LISTENING.reset(token)


@contextmanager
def stage(name: str, total: float | None = None, share: float = 1.0) -> Iterator[Stage]:
    """Tell of a stage of the work; inside another one it does ``share`` of its total."""
    work, new = _LISTENING.get(), Stage(name, total, share)
    if work is None:
        yield new
        return
    outer = work.innermost
    before = outer.done if outer is not None else 0.0
    work.enter(new)
    try:
        yield new
    finally:
        work.leave(new, outer, before)


def steps(
    items: Iterable[T],
    name: str,
    label: Callable[[T], str] | None = None,
    share: float = 1.0,
) -> Iterator[T]:
    """Iterate, telling ``name`` and the number of each item, e.g. "fold 3 of 5", or "``label`` (3 of 5)"."""
    if _LISTENING.get() is None:
        yield from items
        return
    count = len(items) if isinstance(items, Sized) else None
    of_all = "" if count is None else f" of {count}"
    with stage("", count, share) as told:
        for i, item in enumerate(items):
            told.name = f"{name} {i + 1}{of_all}" if label is None else f"{name} {label(item)} ({i + 1}{of_all})"
            yield item
            told.done = i + 1.0


def aside() -> AbstractContextManager[None]:
    """Clear the bar while other output is written to the terminal."""
    work = _LISTENING.get()
    return nullcontext() if work is None else work.screen.aside()
