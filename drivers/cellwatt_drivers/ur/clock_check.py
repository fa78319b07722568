"""Compares the controller's clock with the cell's clock at intervals, over a short extra connection.

No document defines the order in which a controller answers a request and sends packages, so an answer between packages
does not bound the time at which they were made. The RTDE guide does state that a controller sends the most recent data,
and sends none to a connection that has not requested it. So the controller made the first package of a connection after
the request, within one cycle.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from typing import Any, Final, NoReturn

from cellwatt.account import Account
from cellwatt.arrays import Float
from cellwatt.errors import SourceError
from cellwatt_drivers.ur import session as rtde
from cellwatt_drivers.ur.intake import Intake, refuse_strange
from cellwatt_drivers.ur.recipe import Selection

FIRST, USUAL = 1.0, 10.0
"""s until the first comparison, and longest pause; each pause is twice as long as the one before, up to the latter."""
_NOTHING: Final = Selection((), (), False)
"""The timestamp alone."""


async def compare(
    host: str, port: int, rate: float, timeout: float, now: Callable[[], int], account: Account, intake: Intake
) -> NoReturn:
    """Pass the first package of a new connection to the intake, again and again; failed comparisons are counted."""
    pause = FIRST
    while True:
        # At uneven intervals: in step with the controller's cycle, every comparison would give the same loose bound.
        await asyncio.sleep(pause * random.uniform(0.7, 1.3))
        pause = min(2 * pause, USUAL)
        base = intake.resets
        try:
            device, not_before = await _first_package(host, port, rate, timeout, now)
        except (SourceError, TimeoutError):
            account.count("clock comparisons failed")
            continue
        if intake.resets == base:
            intake.compared(device, not_before)


async def _first_package(host: str, port: int, rate: float, timeout: float, now: Callable[[], int]) -> tuple[int, int]:
    newest: asyncio.Future[tuple[int, int]] = asyncio.get_running_loop().create_future()

    def take(time: Float, values: Float, not_before: int | None, arrival: int) -> None:
        refuse_strange(time)
        if not_before is not None and not newest.done():
            newest.set_result((round(float(time[0]) * 1e9), not_before))

    async with rtde.connect(host, port, timeout, now, Account()) as (session, version):
        await rtde.begin(session, version, _NOTHING, rate, take, timeout)
        try:
            ends: set[asyncio.Future[Any]] = {newest, session.closed}
            async with asyncio.timeout(timeout):
                await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            if session.closed.done():
                session.closed.result()
            return newest.result()
        finally:
            session.leave()
