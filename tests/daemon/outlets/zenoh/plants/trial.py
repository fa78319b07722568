"""Runs two plants and headquarters, cuts lines, and tells what arrived."""

from __future__ import annotations

import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.daemon.outlets.zenoh.processes import Child

from . import site
from .network import PLANTS, Network, network

PATIENCE = 120.0
WIDTH = 13
"""Channels of the cells."""


class Process(Child):
    """A module of this package in a namespace; ``said`` is its last line of each kind, by its first key."""

    def __init__(self, net: Network, place: str, module: str, order: dict[str, Any]) -> None:
        self._last: dict[str, Any] = {}
        super().__init__(f"plants.{module}", net.inside(place), **order)
        self.said, self._name = self._last, f"{module} in {place}"

    def hear(self, said: Any) -> None:
        self._last[said if isinstance(said, str) else next(iter(said))] = said

    def answer(self, key: str, patience: float = PATIENCE, **order: Any) -> dict[str, Any]:
        """Give an order and wait for the line that begins with ``key``."""
        self.said.pop(key, None)
        self.send(**order)
        return self.wait(key, patience)[key]  # type: ignore[no-any-return]

    def wait(self, key: str, patience: float = PATIENCE) -> Any:
        return self.until(lambda: self.said.get(key), key, patience)

    def end(self) -> None:
        """Close its input; one that does not end by itself is killed."""
        with self, suppress(subprocess.TimeoutExpired):
            self.finish(20.0)


@dataclass
class Trial:
    """The running network: routers start at once, cells and consumers by ``cell`` and ``consumer``."""

    net: Network
    folder: Path
    stack: ExitStack
    started: list[Process] = field(default_factory=list)

    def cell(self, n: int, rate: float, *, zenoh: dict[str, Any] | None = None, **record: Any) -> Process:
        """Start the cell of a plant with samples at ``rate`` Hz; ``zenoh`` and ``record`` are more settings."""
        order = {"site": f"plant-{n}", "cell": site.CELL, "folder": str(self.folder / f"record{n}"), "rate": rate}
        settings = site.cell_settings(self.folder, n) | (zenoh or {})
        return self.start(f"cell{n}", "cell", order | {"width": WIDTH, "zenoh": settings, "record": record})

    def consumer(self, n: int, how: str = "recorder") -> Process:
        """Start a consumer at headquarters: one that wants every sample of a plant's cell, or a ``board``."""
        link = site.viewer_settings(self.folder, how)
        order = {"site": f"plant-{n}", "cell": site.CELL, "link": link, "how": how}
        return self.start("hq", "consumer", order)

    def start(self, place: str, module: str, order: dict[str, Any]) -> Process:
        """Start a module of this package in a namespace."""
        process = Process(self.net, place, module, order)
        self.stack.callback(process.end)
        self.started.append(process)
        return process

    def ready(self) -> None:
        """Wait until all that were started are ready; they try for ten seconds to reach their routers."""
        for process in self.started:
            process.wait("ready")


@contextmanager
def plants(folder: Path) -> Iterator[Trial]:
    """Two plants and headquarters with their routers, while the context lasts."""
    site.make(folder)
    with network() as net, ExitStack() as stack:
        trial = Trial(net, folder, stack)
        trial.start("hq", "router", {"folder": str(folder / "hq"), "file": "hq.json5", "options": {}})
        for n in PLANTS:
            order = {"folder": str(folder / f"plant{n}"), "file": "router/zenohd.json5", "options": site.uplink(n)}
            trial.start(f"plant{n}", "router", order)
        yield trial


def topics(recorder: Process) -> dict[str, Counter[str]]:
    """What a consumer has, by topic."""
    said = recorder.said.get("topics", {"topics": {}})["topics"]
    return {name: Counter(numbers) for name, numbers in said.items()}


RAW = "raw/arm/samples"
NAMES = {RAW: "samples", "frame": "frames", "alarm": "alarms"}


def begun(recorder: Process) -> None:
    """Wait until a consumer follows all topics of its cell."""
    recorder.until(lambda: all(topics(recorder).get(t) for t in NAMES), "something of each topic")


def caught_up(recorder: Process, made: dict[str, Any], patience: float) -> None:
    """Wait until a consumer has everything that a cell made."""
    for topic, name in NAMES.items():
        if made[name]:
            reached = lambda t=topic, n=name: topics(recorder).get(t, Counter())["next"] >= made[n]  # noqa: E731
            recorder.until(reached, f"all of {topic}", patience)


def judged(recorder: Process, made: dict[str, Any]) -> dict[str, Any]:
    """What is missing, twice, out of order or wrong at a consumer, summed over topics: numbers of the cell's own."""
    found = topics(recorder)
    whole = {t: made[n] - found[t]["first"] for t, n in NAMES.items() if made[n]}
    return {
        "due": sum(whole.values()),
        "got": sum(found[t]["count"] for t in whole),
        "backfilled": sum(found[t]["backfilled"] for t in whole),
        "told as lost": sum(found[t]["lost"] for t in whole),
        **{what: sum(found[t][what] for t in whole) for what in ("holes", "twice", "wrong")},
        "reasons": recorder.said["topics"]["reasons"],
        "counts": recorder.said["topics"]["counts"],
    }


def cut_and_catch_up(
    folder: Path,
    seconds: float,
    rate: float,
    *,
    backfill: str | None = None,
    line: float | None = None,
    before: float = 3.0,
    after: float = 3.0,
    patience: float = PATIENCE,
) -> dict[str, Any]:
    """Cut plant 1 off for ``seconds`` s; plant 2 goes on. What both got, and how many live blocks came meanwhile.

    The line to headquarters carries ``line`` bytes a second; answers about the past get ``backfill``.
    """
    zenoh = {} if backfill is None else {"backfill": backfill}
    with plants(folder) as trial:
        cells = [trial.cell(n, rate, zenoh=zenoh) for n in PLANTS]
        recorders = [trial.consumer(n) for n in PLANTS]
        board = trial.consumer(1, "board")
        trial.ready()
        for cell in cells:
            cell.send(run=None)
        for recorder in recorders:
            begun(recorder)
        if line is not None:
            trial.net.narrow(1, line)
        time.sleep(before)
        trial.net.cut(1)
        time.sleep(seconds)
        live = board.said["live"]["live"]
        trial.net.restore(1)
        back = time.monotonic()
        caught_up(recorders[0], cells[0].answer("told", tell=True), patience)
        caught, live = time.monotonic() - back, board.said["live"]["live"] - live
        time.sleep(after)
        made = [cell.answer("ran", halt=True) for cell in cells]
        for recorder, whole in zip(recorders, made, strict=True):
            caught_up(recorder, whole, patience)
        judgements = [judged(r, m) for r, m in zip(recorders, made, strict=True)]
        return {"caught_up_s": caught, "live": live, "plants": judgements, "cell": made[0]}
