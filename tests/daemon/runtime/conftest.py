"""The runtime is tested with parts that do what a test tells them, on a loop that skips every wait."""

from __future__ import annotations

import asyncio
import random
import selectors
import time
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest

from cellwatt import registry
from tests.daemon.runtime import fakes, one_process


@pytest.fixture(autouse=True)
def _fake_parts(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(registry, "entry_points", fakes.entry_points)
    registry.available.cache_clear()
    for parts in (fakes.DEVICES, fakes.JUDGES, fakes.RECEIVERS):
        parts.clear()
    yield
    for judge in fakes.JUDGES.values():
        judge.gate.set()  # of a test that failed with its stage still waiting
    registry.available.cache_clear()


@pytest.fixture(autouse=True)
def _quick_health(monkeypatch: pytest.MonkeyPatch) -> None:
    """Health is looked at every 2 ms instead of every second."""
    monkeypatch.setattr(one_process, "HEALTH_RATE", 500.0)


@pytest.fixture
def no_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pauses are in the middle of their spread."""
    monkeypatch.setattr(random, "random", lambda: 0.5)


class _Skipping(selectors.DefaultSelector):
    """Moves the clock on instead of waiting."""

    seconds = 1000.0

    def select(self, timeout: float | None = None) -> Any:
        found = super().select(timeout if timeout is None else 0)
        if not found and timeout is not None and timeout > 0:
            self.seconds += timeout
        return found


async def _in_place(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    return function(*args, **kwargs)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> Callable[[Coroutine[Any, Any, None]], None]:
    """Runs a coroutine on a loop where every wait is over at once and the clock shows that it passed.

    ``asyncio.to_thread`` calls its function in place, as the loop would not wait for a thread.
    """
    selector = _Skipping()
    monkeypatch.setattr(time, "monotonic", lambda: selector.seconds)
    monkeypatch.setattr(asyncio, "to_thread", _in_place)

    def run(coroutine: Coroutine[Any, Any, None]) -> None:
        with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selector)) as runner:
            runner.run(coroutine)

    return run
