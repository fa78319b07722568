"""Processes of the benchmark, spoken to in lines: one of JSON for each order, one of JSON for each answer."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).resolve().parent.parent / "capacity.py"


class Child:
    """A Python program that says something first (``ready`` waits for it), and ends with its input."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            [sys.executable, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self.pid = self._process.pid

    def ready(self) -> Child:
        """Wait until it is ready; give it."""
        self.answer()
        return self

    def order(self, what: Any) -> None:
        """Send an order without waiting for its answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(what) + "\n")
        self._process.stdin.flush()

    def answer(self) -> Any:
        """The next answer. Raises ``RuntimeError`` when there is none."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"a process of the benchmark ended ({self._process.wait()})")
        return json.loads(line)

    def ask(self, what: Any) -> Any:
        """An order and its answer."""
        self.order(what)
        return self.answer()

    def end(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


@contextmanager
def running(made: Child) -> Iterator[Child]:
    """A process for as long as the context lasts."""
    try:
        yield made
    finally:
        made.end()


def begun(role: str, **arguments: Any) -> Child:
    """A process of the benchmark, to be ended."""
    return Child([str(SCRIPT), "--role", role, json.dumps(arguments)])


def child(role: str, **arguments: Any) -> AbstractContextManager[Child]:
    """The same for as long as the context lasts."""
    return running(begun(role, **arguments))


def say(what: Any) -> None:
    """Answer."""
    print(json.dumps(what), flush=True)


def orders() -> Iterator[Any]:
    """Orders, until the input ends."""
    for line in sys.stdin:
        yield json.loads(line)
