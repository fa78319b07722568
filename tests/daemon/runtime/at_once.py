"""A loop that skips every wait."""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable, Coroutine
from functools import wraps
from typing import Any, ParamSpec

import pytest

P = ParamSpec("P")


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


def at_once(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """A test that runs on a loop where every wait is over at once and the clock shows that it passed.

    ``asyncio.to_thread`` calls its function in place, as the loop would not wait for a thread.
    """

    @wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        selector = _Skipping()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(time, "monotonic", lambda: selector.seconds)
            patch.setattr(asyncio, "to_thread", _in_place)
            with asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selector)) as runner:
                runner.run(test(*args, **kwargs))

    return run
