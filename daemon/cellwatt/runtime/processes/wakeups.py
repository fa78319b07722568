"""What wakes the supervisor: signals to the daemon, messages of its processes, and their ends."""

from __future__ import annotations

import os
import selectors
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection


class Wakeups:
    """Calls a function when its descriptor becomes readable, and notes signals, within ``listening``.

    ``stop``: SIGTERM or SIGINT has come; ``reload``: SIGHUP has come.
    """

    _selector: selectors.BaseSelector

    def __init__(self) -> None:
        self.stop = self.reload = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Note signals, which also end ``wait``."""

        def note(number: int, _frame: object) -> None:
            if number == signal.SIGHUP:
                self.reload = True
            else:
                self.stop = True

        read, write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        before = {number: signal.signal(number, note) for number in numbers}
        wakeup = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        with selectors.DefaultSelector() as self._selector:
            self.add(read, lambda: os.read(read, 64))
            try:
                yield
            finally:
                signal.set_wakeup_fd(wakeup)
                for number, handler in before.items():
                    signal.signal(number, handler)
                os.close(read)
                os.close(write)

    def add(self, descriptor: Connection | int, ready: Callable[[], object]) -> None:
        """Call ``ready`` when a descriptor becomes readable. Raises ``OSError``."""
        self._selector.register(descriptor, selectors.EVENT_READ, ready)

    def forget(self, descriptor: Connection | int | None) -> None:
        """Do not watch a descriptor any longer, if it is watched."""
        if descriptor is not None and descriptor in self._selector.get_map():
            self._selector.unregister(descriptor)

    def wait(self, seconds: float) -> None:
        """Wait for readable descriptors for up to ``seconds``, and call their functions."""
        for key, _ in self._selector.select(max(seconds, 0.0)):
            if self._selector.get_map().get(key.fd) is key:  # not forgotten by what was handled before it
                key.data()
