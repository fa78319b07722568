"""``cellwatt run`` as a process, with the parts of the runtime's tests: ``fake_run SCENARIO CELL``.

What the parts do was told them before the daemon's processes were forked, and what they did is in its record and log.
"""

from __future__ import annotations

import asyncio
import ctypes
import logging
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from cellwatt import Frames, registry
from cellwatt.commands import main
from cellwatt.results import Result
from tests.daemon.commands.calling import CELL, points_with
from tests.daemon.runtime.fakes import DEVICES, JUDGES, FakeStage, Order, answer, give, prediction, until

MORE = CELL + "  board: {driver: fake, host: board}\n"


def send(number: signal.Signals, times: int = 1) -> Order:
    """A signal to the supervisor, whose child the process of the devices is."""

    async def order(_: object) -> None:
        for _again in range(times):
            os.kill(os.getppid(), number)
            await asyncio.sleep(0)

    return order


def write(file: Path, text: str) -> Order:
    """New settings, where they are whole lines with the record of the old ones."""
    record = f"record: {{folder: {file.parent / 'kept'}}}\n" if text.endswith("\n") else ""

    async def order(_: object) -> None:
        await asyncio.to_thread(file.write_text, text + record)

    return order


def logged(file: Path, words: str) -> Order:
    """Wait until something is in the daemon's log."""

    async def order(_: object) -> None:
        await until(lambda: words in file.with_suffix(".log").read_text())

    return order


def stop(number: signal.Signals) -> Callable[[Path], None]:
    def scenario(_: Path) -> None:
        DEVICES["arm"].tell(answer, give(5), send(number))

    return scenario


def one_source_more(cell: Path) -> None:
    DEVICES["arm"].tell(answer, write(cell, MORE), send(signal.SIGHUP))
    DEVICES["board"].tell(answer, give(2), logged(cell, "reloaded: source board"), send(signal.SIGTERM))


def a_hundred_hangups(cell: Path) -> None:
    hangups = send(signal.SIGHUP, times=50)
    DEVICES["arm"].tell(answer, hangups, write(cell, MORE), hangups)
    DEVICES["board"].tell(answer, give(2), logged(cell, "reloaded: source board"), send(signal.SIGTERM))


def mistake(text: str) -> Callable[[Path], None]:
    def scenario(cell: Path) -> None:
        JUDGES["judge"].refuse = ValueError("the model is of another robot")
        DEVICES["arm"].tell(answer, write(cell, text), send(signal.SIGHUP), logged(cell, "not reloaded"))
        DEVICES["arm"].tell(give(3), send(signal.SIGTERM))

    return scenario


def stage_does_not_fit(_: Path) -> None:
    JUDGES["judge"].refuse = ValueError("the model is of another robot")


def bad_stage(give: Callable[..., Sequence[Result]], told: str) -> Callable[[Path], None]:
    """A stage of the chain ``judge`` does this at its third block; that of the other chain predicts on."""

    def once(frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        judge = JUDGES["judge"]
        judge.made += 1
        return give(frames, upstream) if judge.made == 4 else ()

    def scenario(cell: Path) -> None:
        JUDGES["judge"].give = once
        JUDGES["other"].give = lambda frames, _: [prediction("other", frames.sequence)]
        stop = send(signal.SIGTERM)
        DEVICES["arm"].tell(answer, give_in_time(100), logged(cell, told), give_in_time(50), stop)

    return scenario


def give_in_time(n: int) -> Order:
    """Samples one by one, as a device gives them."""

    async def order(driver: Any) -> None:
        for _ in range(n):
            await give(1)(driver)
            await asyncio.sleep(0.01)

    return order


def aborts(*_: object) -> Sequence[Result]:
    os.abort()


def grows(*_: object) -> Sequence[Result]:
    kept = []
    while True:
        kept.append(bytearray(64 << 20))


def holds_the_interpreter(*_: object) -> Sequence[Result]:
    """A call into C that lets no other thread of its process go on."""
    ctypes.PyDLL(None).sleep(1)
    logging.getLogger("cellwatt").warning("held for 1 s")
    return ()


class AbortingStage(FakeStage):
    """Takes its process with it as it is made."""

    def __init__(self, *_: object) -> None:
        os.abort()


SCENARIOS: dict[str, Callable[[Path], None]] = {
    "SIGTERM": stop(signal.SIGTERM),
    "SIGINT": stop(signal.SIGINT),
    "one source more": one_source_more,
    "a hundred hangups": a_hundred_hangups,
    "not YAML": mistake("site: ["),
    "new stage aborts": mistake(CELL + "stages: {abort: {}}\n"),
    "another site": mistake(CELL.replace("site: plant", "site: other")),
    "stage does not fit": stage_does_not_fit,
    "stage aborts": bad_stage(aborts, "ended by signal SIGABRT"),
    "stage grows": bad_stage(grows, "stage judge failed"),
    "stage holds the interpreter": bad_stage(holds_the_interpreter, "held for 1 s"),
}


if __name__ == "__main__":
    aborting = EntryPoint("abort", "tests.daemon.commands.fake_run:AbortingStage", "cellwatt.stages")
    registry.entry_points = points_with(aborting)  # type: ignore[assignment]
    SCENARIOS[sys.argv[1]](Path(sys.argv[2]))
    sys.argv[1:] = ["run", sys.argv[2]]
    main()
