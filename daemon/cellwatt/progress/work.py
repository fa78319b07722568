"""Nested stages of work, their progress, and a bar or lines that show it.

The active ``Work`` is a context variable, not a parameter: the long loops are ten calls below a command, in functions
that have nothing else to do with a terminal, and the daemon calls the same functions without showing progress.
Progress is written to stderr, so that the output can be piped.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from threading import Event, Lock, Thread
from typing import Final, TextIO, TypeVar

T = TypeVar("T")
_ERASE: Final = "\r\x1b[2K"


@dataclass(eq=False)
class Stage:
    """A stage of the work: ``done`` of ``total``, in any unit; ``share``: its amount of the outer stage's ``total``."""

    name: str
    total: float | None = None
    share: float = 1.0
    done: float = 0.0
    began: float = 0.0

    def advance(self, amount: float = 1.0) -> None:
        """Add the ``amount`` done since the last call."""
        self.done += amount


@dataclass(frozen=True)
class WorkState:
    """Progress to show: ``fraction`` done of the outermost stage, and time ``left``, s, until it ends.

    Both are None if its total is unknown.
    """

    text: str
    fraction: float | None
    left: float | None

    @property
    def figures(self) -> str:
        """Fraction done and time left as text, ``""`` if unknown."""
        if self.fraction is None:
            return ""
        share = f"{100 * self.fraction:.0f} %"
        return share if self.left is None else f"{share}, {duration(self.left)} left"


class Display:
    """Writes a line to ``stream`` per ``show``: ``live`` overwrites the last line, else lines start with the time."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic, *, live: bool = False) -> None:
        self._stream, self._clock, self._live = stream, clock, live
        self._began = clock()
        self._drawn = False

    @property
    def interval(self) -> float:
        """Time, s, between two calls of ``show``."""
        return 0.2 if self._live else 5.0

    def show(self, state: WorkState) -> None:
        """Write e.g. "25 s: fold 3 of 5; 45 %, 25 s left", or draw a bar."""
        if self._live:
            line = " ".join(filter(None, (f"{'━' * round(16 * (state.fraction or 0)):<16}", state.figures, state.text)))
            self._stream.write(_ERASE + line[: self._width() - 1])
            self._drawn = True
        else:
            words = "; ".join(filter(None, (state.text, state.figures)))
            self._stream.write(f"{duration(self._clock() - self._began)}: {words}\n")
        self._stream.flush()

    def clear(self) -> None:
        """Erase the bar; lines are not erased."""
        if self._drawn:
            self._drawn = False
            with suppress(OSError, ValueError):  # the stream is closed
                self._stream.write(_ERASE)
                self._stream.flush()

    def _width(self) -> int:
        try:
            return os.get_terminal_size(self._stream.fileno()).columns or 80
        except OSError:
            return 80


class Work:
    """The open stages, outermost first, and their display.

    A thread updates the display at intervals, so that a long computation does not block it. The first stage starts the
    thread, so that short commands do without; ``close`` ends it.
    """

    def __init__(
        self,
        display: Display,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[Event, float], bool] = Event.wait,
    ) -> None:
        self._display, self._clock, self._wait = display, clock, wait
        self._open: tuple[Stage, ...] = ()  # replaced, not changed: the thread reads it
        self._lock, self._over = Lock(), Event()
        self._thread: Thread | None = None

    def enter(self, stage: Stage) -> None:
        """Begin a stage inside the innermost open stage."""
        stage.began = self._clock()
        self._open = (*self._open, stage)
        if self._thread is None:
            self._thread = Thread(target=self._watch, name="progress", daemon=True)
            self._thread.start()

    def leave(self, stage: Stage, outer: Stage | None, before: float) -> None:
        """End a stage and all stages inside it; ``before`` is what ``outer`` had done when the stage began."""
        if stage not in self._open:
            return
        if outer is not None:
            outer.done = before + stage.share
        self._open = self._open[: self._open.index(stage)]
        if not self._open:
            self._clear()

    @property
    def innermost(self) -> Stage | None:
        """The stage that began last."""
        return self._open[-1] if self._open else None

    def state(self) -> WorkState | None:
        """Current progress; None if no stage is open."""
        stages = self._open
        if not stages:
            return None
        inside, fraction = 0.0, None
        for stage in reversed(stages):
            fraction = min((stage.done + inside) / stage.total, 1.0) if stage.total else None
            inside = stage.share * (fraction or 0.0)
        left = (self._clock() - stages[0].began) * (1 / fraction - 1) if fraction else None
        return WorkState(", ".join(stage.name for stage in stages if stage.name), fraction, left)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Clear the display while other output is written."""
        with self._lock:
            self._display.clear()
            yield

    def close(self) -> None:
        """End the thread and clear the display."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        self._clear()

    def _clear(self) -> None:
        with self.aside():
            pass

    def _watch(self) -> None:
        while not self._wait(self._over, self._display.interval):
            with self._lock:
                try:
                    if (state := self.state()) is not None:
                        self._display.show(state)
                except (OSError, ValueError):  # a closed pipe or file must not end the work
                    return


_LISTENING: ContextVar[Work | None] = ContextVar("listening", default=None)


@contextmanager
def listening(work: Work) -> Iterator[Work]:
    """Make ``work`` receive the stages that begin inside the block."""
    token = _LISTENING.set(work)
    try:
        yield work
    finally:
        _LISTENING.reset(token)
        work.close()


@contextmanager
def show_progress(quiet: bool = False) -> Iterator[None]:
    """Show the progress of work in the block: a bar if stderr is a terminal, else a line every 5 s; not if ``quiet``.

    with cw.show_progress():
        found = cw.explain("runs", robot="robot.yaml")
    """
    live = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    with nullcontext() if quiet else listening(Work(Display(sys.stderr, live=live))):
        yield


@contextmanager
def stage(name: str, total: float | None = None, share: float = 1.0) -> Iterator[Stage]:
    """Show a stage of the work; inside another stage it accounts for ``share`` of that stage's total."""
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
    """Iterate and show ``name`` and the number of each item, e.g. "fold 3 of 5", or ``name`` and ``label``."""
    count = len(items) if isinstance(items, Sized) else None
    of_all = "" if count is None else f" of {count}"
    with stage("", count, share) as current:
        for i, item in enumerate(items):
            current.name = f"{name} {i + 1}{of_all}" if label is None else f"{name} {label(item)} ({i + 1}{of_all})"
            yield item
            current.done = i + 1.0


def aside() -> AbstractContextManager[None]:
    """Clear the bar while other output is written to the terminal."""
    work = _LISTENING.get()
    return nullcontext() if work is None else work.aside()


def duration(seconds: float) -> str:
    """A duration as text: "25 s", "12 min", "2.5 h"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
