"""Processes of the benchmark: modules of this package, spoken to in lines of JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent.parent
END = 10.0
"""s for the end of a process after that of its input."""


class Child:
    """A process that says something first, answers orders, and ends with its input."""

    def __init__(self, module: str, *words: str) -> None:
        paths = {"PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])}
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"outlet.{module}", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **paths},
        )
        self.pid = self.process.pid

    def order(self, what: Any) -> None:
        """Send an order without waiting for its answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()

    def answer(self) -> Any:
        """The next answer; blocks. Raises ``RuntimeError`` when the process has ended."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"a process of the benchmark ended ({self.process.wait()})")
        return json.loads(line)

    def ask(self, what: Any) -> Any:
        """An order and its answer; blocks."""
        self.order(what)
        return self.answer()

    def end(self) -> None:
        """End its input, and with it the process."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(END)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


@contextmanager
def child(module: str, *words: str) -> Iterator[Child]:
    """A process of the benchmark for as long as the context lasts."""
    made = Child(module, *words)
    try:
        yield made
    finally:
        made.end()


def say(what: Any) -> None:
    """Answer."""
    print(json.dumps(what), flush=True)
