"""Compares the controller's clock with the cell's now and then, over a short connection of its own.

No document says in which order a controller answers a question and sends packages, so an answer between packages tells
nothing about when these were made. The RTDE guide does say that a controller sends the most recent data, and nothing to
a connection that has not asked for it. So the first package of a connection was made after that connection asked, give
or take a cycle.
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
"""s until the first comparison; each pause is twice as long as the one before, up to the usual one."""
_NOTHING: Final = Selection((), (), False)
"""Only the timestamp."""


async def compare(
    host: str, port: int, rate: float, timeout: float, now: Callable[[], int], account: Account, intake: Intake
) -> NoReturn:
    """Tell the intake again and again what a new connection shows; where it shows nothing, that is counted."""
    pause = FIRST
    while True:
        # At uneven times: in step with the controller's cycle, every comparison would be as loose as the last.
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
