"""Runs two plants and headquarters, cuts lines, and tells what arrived."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.daemon.outlets.zenoh.processes import Child
from tests.daemon.outlets.zenoh.test_link_cut import assert_complete, joined, reached, received

from . import site
from .network import PLANTS, Network, network

PATIENCE = 120.0
RAW = "raw/arm/samples"
NAMES = {RAW: "samples", "frame": "frames", "alarm": "alarms"}


class Process(Child):
    """A process of the tests in a namespace."""

    def __init__(self, net: Network, place: str, module: str, order: dict[str, Any]) -> None:
        super().__init__(module, net.inside(place), **order)
        self._name = f"{module} in {place}"

    def answer(self, key: str, patience: float = PATIENCE, **order: Any) -> dict[str, Any]:
        """Give an order and wait for the line that begins with ``key``."""
        before = len(self.said)
        self.send(**order)
        return self.until(lambda: next((s[key] for s in self.said[before:] if key in s), None), key, patience)

    def publish(self, rate: float) -> None:
        """Publish samples at ``rate`` Hz, 50 frames a second and an alarm a second until it is halted."""
        self.send(stream={"samples": None, "frames_too": True, "every": 50, "rate": rate, "block": round(rate / 50)})

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

    def cell(self, n: int, *, backfill: str | None = None, **record: Any) -> Process:
        """Start the cell of a plant; ``backfill`` and ``record`` are more settings."""
        settings = site.cell_settings(self.folder, n) | {"backfill": backfill, "record": record}
        folder = str(self.folder / f"record{n}")
        return self.start(f"cell{n}", "cell_process", settings | {"site": f"plant-{n}", "folder": folder})

    def consumer(self, n: int) -> Process:
        """Start a consumer at headquarters that wants every sample of a plant's cell."""
        more = {"site": f"plant-{n}", "want": [*NAMES, "health"]}
        return self.start("hq", "consumer_process", site.viewer_settings(self.folder, "recorder") | more)

    def board(self, n: int) -> Process:
        """Start a board at headquarters that counts the live blocks of a plant's cell."""
        order = {"site": f"plant-{n}", "link": site.viewer_settings(self.folder, "board")}
        return self.start("hq", "plants.board", order)

    def start(self, place: str, module: str, order: dict[str, Any]) -> Process:
        """Start a module in a namespace."""
        process = Process(self.net, place, module, order)
        self.stack.callback(process.end)
        self.started.append(process)
        return process

    def ready(self, *consumers: Process) -> None:
        """Wait until all are ready, and consumers know where their cells are, through both routers."""
        for process in self.started:
            process.wait_for(lambda s: s == "ready", "ready", PATIENCE)
        for consumer in consumers:
            joined(consumer)


@contextmanager
def plants(folder: Path) -> Iterator[Trial]:
    """Two plants and headquarters with their routers, while the context lasts."""
    site.make(folder)
    with network() as net, ExitStack() as stack:
        trial = Trial(net, folder, stack)
        trial.start("hq", "plants.router", {"folder": str(folder / "hq"), "file": "hq.json5", "options": {}})
        for n in PLANTS:
            order = {"folder": str(folder / f"plant-{n}"), "file": "router/zenohd.json5", "options": site.uplink(n)}
            trial.start(f"plant{n}", "plants.router", order)
        yield trial


def begun(consumer: Process) -> None:
    """Wait until a consumer follows all topics of its cell."""
    consumer.until(lambda: all(received(consumer, topic) for topic in NAMES), "something of each topic")


def caught_up(consumer: Process, made: dict[str, int], patience: float = PATIENCE) -> None:
    """Wait until a consumer has everything that a cell made."""
    for topic, name in NAMES.items():
        consumer.until(lambda t=topic, n=name: reached(consumer, t, made[n]), f"all of {topic}", patience)  # type: ignore[misc]


def assert_whole(consumer: Process, made: dict[str, int]) -> None:
    """Everything that the cell made came once, in order, with its own values."""
    for topic, name in NAMES.items():
        assert_complete(received(consumer, topic), 0, made[name])
