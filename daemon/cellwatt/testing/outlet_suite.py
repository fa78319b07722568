"""The conformance suite of outlets, a class for pytest: peers that disconnect, stay silent, refuse or lie; restarts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from cellwatt.outlet import Outlet
from cellwatt.testing.outlet_rig import FarEnd, Line, OutletRig, line_to, running_outlet
from cellwatt.testing.recorded_cell import LAYOUT, RecordedCell
from cellwatt.testing.rig import NotConformingError, require

if TYPE_CHECKING:
    import pytest

_ROW = 5
"""Frames per row."""
_SETTLES = 40
"""Rows after which all earlier ones are settled in the recording."""
_STILL = 0.5
"""Longest time for which the event loop may be blocked, s."""


class _Trial:
    """A cell, its recording, and a peer behind a line, for one check."""

    def __init__(self, rig: OutletRig, folder: Path, peer: FarEnd, line: Line) -> None:
        self.rig, self.folder, self.peer, self.line = rig, folder, peer, line
        self.cell = RecordedCell(folder)

    def make(self) -> Outlet[Any]:
        return self.rig.make(self.line.address, self.cell)

    def rows(self, count: int, *outlets: Outlet[Any]) -> None:
        """Make rows, one block each, and offer them to the outlets."""
        for _ in range(count):
            block = self.cell.frames(_ROW)
            for outlet in outlets:
                outlet.offer(block)

    @property
    def times(self) -> list[int]:
        """Times of all rows that were made."""
        return [self.cell.session + (n + 1) * _ROW * LAYOUT.step for n in range(self.cell.made // _ROW)]

    async def until(self, condition: Callable[[], object], what: str, outlet: Outlet[Any]) -> None:
        end = time.monotonic() + self.rig.patience
        while not condition():
            if time.monotonic() > end:
                raise NotConformingError(
                    f"{what}: not within {self.rig.patience:g} s; the peer has {len(self.peer.got)} rows of "
                    f"{len(self.times)}; trouble: {outlet.trouble()}; account: {outlet.account.snapshot()}"
                )
            await asyncio.sleep(0.01)

    async def all_there(self, outlet: Outlet[Any]) -> None:
        """Wait until the peer has every row and the account confirms it."""
        await self.until(lambda: set(self.times) <= set(self.peer.got), "all rows", outlet)
        require(set(self.peer.got) == set(self.times), "the peer has rows that were never made")
        await self.until(lambda: not outlet.account.owed, "an account without owed rows", outlet)
        require(outlet.account.residue == 0, f"the account does not balance: {outlet.account.snapshot()}")
        await self.until(lambda: outlet.trouble() is None, "the end of the trouble", outlet)

    async def recovers(self, outlet: Outlet[Any]) -> None:
        """Mend the line; wait until the peer has every row, new ones included."""
        self.line.be("well")
        self.rows(_SETTLES, outlet)
        await self.all_there(outlet)


@asynccontextmanager
async def _trial(rig: OutletRig, folder: Path) -> AsyncIterator[_Trial]:
    async with rig.peer() as peer, line_to(peer) as line:
        trial = _Trial(rig, folder, peer, line)
        try:
            yield trial
        finally:
            trial.cell.close()


async def arrives(trial: _Trial) -> None:
    """Require that all rows arrive in order, except the first, of which the outlet may have missed frames."""
    outlet = trial.make()
    async with running_outlet(outlet):
        trial.rows(60, outlet)
        await trial.all_there(outlet)
    came = [t for t in dict.fromkeys(trial.peer.got) if t != trial.times[0]]
    require(came == trial.times[1:], "rows arrived in another order")


async def survives_a_cut(trial: _Trial) -> None:
    """Require that rows made while the peer was disconnected arrive later, along with new ones."""
    outlet = trial.make()
    async with running_outlet(outlet) as ends:
        trial.rows(20, outlet)
        await trial.until(lambda: len(trial.peer.got) >= 19, "rows", outlet)
        trial.line.be("cut")
        trial.rows(30, outlet)
        await trial.until(lambda: outlet.trouble() or ends, "reported trouble", outlet)
        await trial.recovers(outlet)


async def goes_on_after_a_restart(trial: _Trial) -> None:
    """Require that rows recorded while no outlet ran arrive later, and none twice after a clean end."""
    first, second = trial.make(), trial.make()
    async with running_outlet(first):
        trial.rows(60, first)
        await trial.all_there(first)
        await trial.until(lambda: first.account.received >= len(trial.times), "a confirmation of each row", first)
    known, before = set(trial.times), len(trial.peer.got)
    trial.rows(25)
    async with running_outlet(second):
        await trial.recovers(second)
    require(not known & set(trial.peer.got[before:]), "rows from before the restart arrived twice")


async def loses_nothing_when_killed(trial: _Trial) -> None:
    """Require that a position saved before the kill leads to all rows, some of them twice."""
    first, second = trial.make(), trial.make()
    async with running_outlet(first):
        trial.rows(20, first)
        await trial.until(lambda: list(trial.folder.glob(trial.rig.position)), "a file of its position", first)
        positions = {path: path.read_bytes() for path in trial.folder.glob(trial.rig.position)}
        trial.rows(20, first)
        await trial.until(lambda: len(trial.peer.got) >= 30, "rows", first)
    for path, content in positions.items():
        path.write_bytes(content)
    async with running_outlet(second):
        await trial.recovers(second)


async def is_owed_from_its_first_start(trial: _Trial) -> None:
    """Require that rows of a start that never reached its peer arrive after the next start, with those in between."""
    first, second = trial.make(), trial.make()
    trial.line.be("cut")
    async with running_outlet(first) as ends:
        trial.rows(20, first)
        await trial.until(lambda: first.trouble() or ends, "reported trouble", first)
    trial.rows(10)
    trial.line.be("well")
    async with running_outlet(second):
        await trial.recovers(second)


async def is_not_held_up_by_silence(trial: _Trial) -> None:
    """Require that a peer that accepts data but never answers is reported, and blocks neither loop nor rows."""
    outlet = trial.make()
    trial.line.be("silent")
    async with running_outlet(outlet) as ends:
        worst, last = 0.0, time.monotonic()
        trial.rows(20, outlet)
        while not (outlet.trouble() or ends):
            await asyncio.sleep(0.01)
            worst, last = max(worst, time.monotonic() - last), time.monotonic()
        require(worst < _STILL, f"the event loop was blocked for {worst:.2f} s: block in a thread")
        require(not trial.peer.got and outlet.account.received == 0, "rows without an answer count as delivered")
        await trial.recovers(outlet)


async def believes_no_garbage(trial: _Trial) -> None:
    """Require that an invalid answer is reported, and confirms nothing."""
    outlet = trial.make()
    trial.line.be("lies")
    async with running_outlet(outlet) as ends:
        trial.rows(20, outlet)
        await trial.until(lambda: outlet.trouble() or ends, "reported trouble", outlet)
        require(outlet.account.received == 0, "garbage counts as a confirmation")
        await trial.recovers(outlet)


async def counts_what_is_refused(trial: _Trial) -> None:
    """Require that rows refused permanently are counted and not sent for ever."""
    outlet = trial.make()
    trial.peer.refuse = True
    async with running_outlet(outlet):
        trial.rows(60, outlet)
        await trial.until(lambda: outlet.account.missed.total() >= 60, "60 missed rows", outlet)
        require(not trial.peer.got and outlet.account.residue == 0, f"unbalanced: {outlet.account.snapshot()}")
        trial.peer.refuse = False
        trial.rows(10, outlet)
        await trial.until(lambda: len(trial.peer.got) >= 10, "later rows", outlet)


CHECKS = (
    arrives,
    survives_a_cut,
    goes_on_after_a_restart,
    loses_nothing_when_killed,
    is_owed_from_its_first_start,
    is_not_held_up_by_silence,
    believes_no_garbage,
    counts_what_is_refused,
)


class OutletConformance:
    """Derive from it and set ``rigs``: each check of each outlet is a test."""

    rigs: ClassVar[Sequence[OutletRig]] = ()

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """One test for each rig and check."""
        cases = [(rig, check) for rig in self.rigs for check in CHECKS]
        names = [f"{rig.outlet.__name__}-{check.__name__}" for rig, check in cases]
        metafunc.parametrize(("rig", "check"), cases, ids=names)

    def test_outlet(self, rig: OutletRig, check: Any, tmp_path: Path) -> None:
        """The outlet passes this check of the contract."""

        async def run() -> None:
            async with _trial(rig, tmp_path) as trial:
                await check(trial)

        asyncio.run(run())
