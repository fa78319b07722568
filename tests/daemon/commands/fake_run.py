"""``cellwatt run`` as a process, with the parts of the runtime's tests: ``fake_run SCENARIO CELL``.

What the parts do was told them before the daemon's processes were forked, and what they did is in its record and log.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from cellwatt import registry
from cellwatt.commands import main
from tests.daemon.commands.calling import CELL
from tests.daemon.runtime import fakes
from tests.daemon.runtime.fakes import DEVICES, JUDGES, Order, answer, give, until

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


SCENARIOS: dict[str, Callable[[Path], None]] = {
    "SIGTERM": stop(signal.SIGTERM),
    "SIGINT": stop(signal.SIGINT),
    "one source more": one_source_more,
    "a hundred hangups": a_hundred_hangups,
    "not YAML": mistake("site: ["),
    "no such driver": mistake(CELL.replace("fake", "fakes")),
    "stage refused": mistake(CELL + "stages: {judge: {}}\n"),
    "another site": mistake(CELL.replace("site: plant", "site: other")),
    "stage does not fit": stage_does_not_fit,
}


def points(group: str) -> list[EntryPoint]:
    """Stands for ``importlib.metadata.entry_points``."""
    return list(entry_points(group=group)) if group == "cellwatt.commands" else fakes.entry_points(group)


if __name__ == "__main__":
    registry.entry_points = points  # type: ignore[assignment]
    SCENARIOS[sys.argv[1]](Path(sys.argv[2]))
    sys.argv[1:] = ["run", sys.argv[2]]
    main()
