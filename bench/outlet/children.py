"""Processes of the benchmark, spoken to in lines: one of JSON for each order, one of JSON for each answer."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent.parent


class Child:
    """A Python program that says something first (``ready`` waits for it), and ends with its input."""

    def __init__(self, module: str, *words: str) -> None:
        paths = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])}
        command = [sys.executable, "-m", f"outlet.{module}", *words]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=paths)
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
def child(module: str, *words: str) -> Iterator[Child]:
    """A module of this package as a process for as long as the context lasts."""
    made = Child(module, *words)
    try:
        yield made
    finally:
        made.end()


def say(what: Any) -> None:
    """Answer."""
    print(json.dumps(what), flush=True)


def orders() -> Iterator[Any]:
    """Orders, until the input ends."""
    for line in sys.stdin:
        yield json.loads(line)


def free_port() -> int:
    """A free TCP port of this host."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
