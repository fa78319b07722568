"""Work as a bar on a terminal, as a line now and then elsewhere; always on stderr, so that output can be piped."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Protocol, TextIO

from cellwatt.progress.work import Told, Work, listening

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

EVERY = 5.0
"""s between two lines where there is no terminal."""
REDRAWN = 0.2
"""s between two states of the bar."""


class Display(Protocol):
    """A form in which work is shown."""

    interval: float
    """s between two calls of ``show``."""

    def show(self, told: Told) -> None:
        """Show the work as it is now."""

    def clear(self) -> None:
        """Take away what is shown."""


class Lines:
    """A line on ``stream`` for each ``show``, with the time since the work began."""

    interval = EVERY

    def __init__(self, stream: TextIO, clock: Callable[[], float]) -> None:
        self._stream, self._clock = stream, clock
        self._began = clock()

    def show(self, told: Told) -> None:
        """Write a line."""
        print(f"{duration(self._clock() - self._began)}: {in_words(told)}", file=self._stream, flush=True)

    def clear(self) -> None:
        """Leave the lines where they are."""


class Bar:
    """A bar with the time left, that vanishes."""

    interval = REDRAWN

    def __init__(self, console: Console) -> None:
        self._console = console
        self._progress: Progress | None = None

    def show(self, told: Told) -> None:
        """Draw the bar, or its new state."""
        progress = self._progress or self._started()
        progress.update(
            progress.task_ids[0],
            description=told.text,
            total=None if told.fraction is None else 1.0,
            completed=told.fraction or 0.0,
            figures=_figures(told),
        )
        progress.refresh()

    def clear(self) -> None:
        """Take the bar away."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None

    def _started(self) -> Progress:
        from rich.progress import BarColumn, Progress, TextColumn
        from rich.table import Column

        columns = (
            BarColumn(bar_width=16),
            TextColumn("{task.fields[figures]}", table_column=Column(no_wrap=True)),
            TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, ratio=1)),
        )
        # Output of others is not to be moved from stdout to the console, which is stderr.
        self._progress = Progress(
            *columns,
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


class Watching:
    """A screen that looks at the work from a thread: a single long computation does not hold up what is shown.

    The thread begins with the first stage, so that short commands have none, and ends with ``close``.
    """

    def __init__(self, display: Callable[[], Display], wait: Callable[[Event, float], bool] = Event.wait) -> None:
        self._make, self._wait = display, wait
        self._display: Display | None = None
        self._lock, self._over = Lock(), Event()
        self._thread: Thread | None = None

    def begin(self, work: Work) -> None:
        """See ``Screen.begin``."""
        if self._thread is None:
            self._display = self._make()
            self._thread = Thread(target=self._watch, args=(work, self._display), name="progress", daemon=True)
            self._thread.start()

    def end(self) -> None:
        """See ``Screen.end``."""
        with self.aside():
            pass

    @contextmanager
    def aside(self) -> Iterator[None]:
        """See ``Screen.aside``."""
        with self._lock:
            if self._display is not None:
                self._display.clear()
            yield

    def close(self) -> None:
        """End the thread and clear what is shown."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        self.end()

    def _watch(self, work: Work, display: Display) -> None:
        while not self._wait(self._over, display.interval):
            with self._lock:
                told = work.told()
                if told is not None and not _shows(display, told):
                    return


@contextmanager
def show_progress(quiet: bool = False) -> Iterator[None]:
    """Show the work that is done inside: a bar where stderr is a terminal, else a line every 5 s; none if ``quiet``.

    with cw.show_progress():
        found = cw.explain("runs", robot="robot.yaml")
    """
    if quiet:
        yield
        return
    screen = Watching(_display)
    work = Work(screen)
    try:
        with listening(work):
            yield
    finally:
        screen.close()


def _display() -> Display:
    from time import monotonic

    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        return Lines(sys.stderr, monotonic)
    from rich.console import Console

    return Bar(Console(stderr=True))


def _shows(display: Display, told: Told) -> bool:
    """Show the work; False where nobody reads any more, which is no reason to end the work."""
    try:
        display.show(told)
    except (OSError, ValueError):  # a pipe or a file that is closed
        return False
    return True


def in_words(told: Told) -> str:
    """The state of the work as a line, e.g. "fold 3 of 5; 45 %, 25 s left"."""
    return "; ".join(filter(None, (told.text, _figures(told))))


def _figures(told: Told) -> str:
    """Share done and time left, as far as they are known."""
    if told.fraction is None:
        return ""
    share = f"{100 * told.fraction:.0f} %"
    return share if told.left is None else f"{share}, {duration(told.left)} left"


def duration(seconds: float) -> str:
    """A time as people say it: "25 s", "12 min", "2.5 h"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
