"""Stages of work inside one another, how far they are, and a bar or lines that say so.

The one that listens is a context variable, not a parameter: the loops that take long lie ten calls below a command, in
functions that have nothing else to do with a terminal, and the daemon calls the same ones with nobody there. All is
written to stderr, so that output can be piped.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, TextIO, TypeVar

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

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
    """State of the work as it is shown: ``fraction`` of the outermost stage, and ``left`` s until that ends.

    None where its total is not known.
    """

    text: str
    fraction: float | None
    left: float | None

    @property
    def figures(self) -> str:
        """Share done and time left, as far as they are known."""
        if self.fraction is None:
            return ""
        share = f"{100 * self.fraction:.0f} %"
        return share if self.left is None else f"{share}, {duration(self.left)} left"


class Lines:
    """A line on ``stream`` for each ``show``, with the time since the work began."""

    interval = 5.0
    """s between two calls of ``show``."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream, clock
        self._began = clock()

    def show(self, told: Told) -> None:
        """Write a line, e.g. "25 s: fold 3 of 5; 45 %, 25 s left"."""
        words = "; ".join(filter(None, (told.text, told.figures)))
        print(f"{duration(self._clock() - self._began)}: {words}", file=self._stream, flush=True)

    def clear(self) -> None:
        """Leave the lines where they are."""


class Bar:
    """A bar with the time left, that vanishes."""

    interval = 0.2
    """s between two calls of ``show``."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._progress: Progress | None = None

    def show(self, told: Told) -> None:
        """Draw the bar, or its new state."""
        progress = self._progress or self._started()
        total = None if told.fraction is None else 1.0
        done, task = told.fraction or 0.0, progress.task_ids[0]
        progress.update(task, description=told.text, total=total, completed=done, figures=told.figures)
        progress.refresh()

    def clear(self) -> None:
        """Take the bar away."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def _started(self) -> Progress:
        from rich.progress import BarColumn, Progress, TextColumn
        from rich.table import Column

        # Output of others is not to be moved from stdout to the console, which is stderr.
        self._progress = Progress(
            BarColumn(bar_width=16),
            TextColumn("{task.fields[figures]}", table_column=Column(no_wrap=True)),
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, ratio=1)),
            console=self._console,
            auto_refresh=False,
            transient=True,
            expand=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._progress.add_task("", figures="")
        self._progress.start()
        self._console.show_cursor(True)  # a process that is killed cannot bring it back
        return self._progress


class Work:
    """The stages that are open, outermost first, and what shows them.

    A thread looks at them now and then: a single long computation does not hold up what is shown. It begins with the
    first stage, so that short commands have none, and ends with ``close``.
    """

    def __init__(
        self,
        display: Callable[[], Lines | Bar],
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[Event, float], bool] = Event.wait,
    ) -> None:
        self._make, self._clock, self._wait = display, clock, wait
        self._display: Lines | Bar | None = None
        self._open: tuple[Stage, ...] = ()  # replaced, not changed: the thread reads it
        self._lock, self._over = Lock(), Event()
        self._thread: Thread | None = None

    def enter(self, stage: Stage) -> None:
        """Begin a stage inside the ones that are open."""
        stage.began = self._clock()
        self._open = (*self._open, stage)
        if self._thread is None:
            self._display = self._make()
            self._thread = Thread(target=self._watch, args=(self._display,), name="progress", daemon=True)
            self._thread.start()

    def leave(self, stage: Stage, outer: Stage | None, before: float) -> None:
        """End a stage and what was left open inside it; ``outer`` had done ``before`` when it began."""
        if stage not in self._open:
            return
        if outer is not None:
            outer.done = before + stage.share
        self._open = self._open[: self._open.index(stage)]
        if not self._open:
            with self.aside():
                pass

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
        left = (self._clock() - stages[0].began) * (1 / fraction - 1) if fraction else None
        return Told(", ".join(stage.name for stage in stages if stage.name), fraction, left)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Clear what is shown, until output of another kind is written."""
        with self._lock:
            if self._display is not None:
                self._display.clear()
            yield

    def close(self) -> None:
        """End the thread and clear what is shown."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        with self.aside():
            pass

    def _watch(self, display: Lines | Bar) -> None:
        while not self._wait(self._over, display.interval):
            with self._lock:
                try:
                    if (told := self.told()) is not None:
                        display.show(told)
                except (OSError, ValueError):  # a pipe or a file that is closed: no reason to end the work
                    return


_LISTENING: ContextVar[Work | None] = ContextVar("listening", default=None)


@contextmanager
def listening(work: Work) -> Iterator[Work]:
    """Let ``work`` take the stages that are begun inside."""
    token = _LISTENING.set(work)
    try:
        yield work
    finally:
        _LISTENING.reset(token)
        work.close()


@contextmanager
def show_progress(quiet: bool = False) -> Iterator[None]:
    """Show the work that is done inside: a bar where stderr is a terminal, else a line every 5 s; none if ``quiet``.

    with cw.show_progress():
        found = cw.explain("runs", robot="robot.yaml")
    """
    with nullcontext() if quiet else listening(Work(_display)):
        yield


def _display() -> Lines | Bar:
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        return Lines(sys.stderr)
    from rich.console import Console

    return Bar(Console(stderr=True))


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
    return nullcontext() if work is None else work.aside()


def duration(seconds: float) -> str:
    """A time as people say it: "25 s", "12 min", "2.5 h"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
