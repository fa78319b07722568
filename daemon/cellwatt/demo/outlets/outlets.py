"""The outlets of the demo's cell: their settings, their programs, and the clients that read them back."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from cellwatt.demo import cells
from cellwatt.demo.outlets import programs
from cellwatt.demo.outlets.readers import read_mqtt, read_opc_ua, read_prometheus
from cellwatt.demo.outlets.said import Compared, Said

PROMETHEUS, MQTT, OPC_UA = "Prometheus", "MQTT", "OPC UA"
START: Final = 30.0
"""Longest time, s, until each outlet has told frames and health."""
LATE: Final = 10.0
"""Longest time, s, that an alarm takes to all outlets once one has told it; Prometheus scrapes each second."""
_COMPARE: Final = 0.25
_INSTALL: Final = {
    PROMETHEUS: "the program prometheus is not here: apt-get install prometheus",
    MQTT: "there is no broker, as the program mosquitto is not here: apt-get install mosquitto",
}
_CHANNELS: Final = ["*.supply.power", "arm.joint_*.position", "arm.joint_*.current"]
_RATE: Final = "50 Hz"
"""That of the frames: what Prometheus scrapes is a frame that the others tell as well."""


class Outlets:
    """Prometheus, MQTT and OPC UA beside the demo in ``folder``; what lacks a program is in ``left_out``, with why."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "outlets"
        self._programs = {PROMETHEUS: programs.find("prometheus"), MQTT: programs.find("mosquitto")}
        self._metrics, self._server, self._broker, self._opc_ua = (cells.free_endpoint() for _ in range(4))
        self.left_out = {name: _INSTALL[name] for name, program in self._programs.items() if program is None}
        self._url, port = f"opc.tcp://{self._opc_ua}/cellwatt", self._broker.rpartition(":")[2]
        looks = {
            PROMETHEUS: f"http://{self._server} (query: cellwatt_power_watts)",
            "metrics": f"http://{self._metrics}/metrics",
            MQTT: f"mosquitto_sub -p {port} -t 'cellwatt/#' -v",
            OPC_UA: f"{self._url} (any OPC UA browser)",
        }
        self.looks = {name: look for name, look in looks.items() if name not in self.left_out}
        """Ways to look at each outlet by hand, while ``open``."""
        self.open = False
        self.said = [Said(name) for name in (PROMETHEUS, MQTT, OPC_UA) if name not in self.left_out]
        self.compared = Compared()

    def settings(self) -> Path:
        """Write the settings of the demo's cell with its outlets; return the file."""
        packaged = cells.packaged()
        cell = yaml.safe_load(packaged.read_text())
        cell["stages"]["faults"]["reference"] = str(packaged.with_name(cell["stages"]["faults"]["reference"]))
        sent = {"channels": _CHANNELS, "rate": _RATE}
        cell["metrics"] = {"listen": self._metrics}
        cell["opc_ua"] = {"listen": self._opc_ua, **sent}
        if MQTT not in self.left_out:
            cell["mqtt"] = {"broker": f"mqtt://{self._broker}", "health": "0.5 s", **sent}
        self._folder.mkdir(exist_ok=True)
        file = self._folder / "cell.yaml"
        file.write_text(yaml.safe_dump(cell, sort_keys=False))
        return file

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run Mosquitto and Prometheus, where they are installed. Raises ``CellwattError`` if one does not come up."""
        broker, server = self._programs[MQTT], self._programs[PROMETHEUS]
        async with contextlib.AsyncExitStack() as stack:
            if broker is not None:
                await stack.enter_async_context(programs.mosquitto(broker, self._folder, self._broker))
            if server is not None:
                made = programs.prometheus(server, self._folder, self._server, self._metrics)
                await stack.enter_async_context(made)
            yield

    @contextlib.asynccontextmanager
    async def reading(self, stopping: asyncio.Event) -> AsyncIterator[None]:
        """Read all outlets; begin the block when each has told something, or ``stopping`` is set, or START is over.

        An alarm that one of them has told at the end of the block is waited for in the others, for at most LATE.
        """
        self.open = True
        tasks = [asyncio.create_task(work) for work in (*self._readers(), self._compare())]

        async def until(condition: Callable[[], bool], seconds: float) -> None:
            end = time.monotonic() + seconds
            while not (condition() or stopping.is_set() or time.monotonic() > end):
                await asyncio.wait(tasks, timeout=0.1, return_when=asyncio.FIRST_COMPLETED)
                _raise_of(tasks)

        try:
            await until(lambda: all(said.complete for said in self.said), START)
            yield
            await until(lambda: len({said.heard is None for said in self.said}) == 1, LATE)
        finally:
            self.open = False
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
        _raise_of(tasks)

    def _readers(self) -> list[Coroutine[Any, Any, None]]:
        read = {
            PROMETHEUS: lambda said: read_prometheus(said, self._server),
            MQTT: lambda said: read_mqtt(said, self._broker),
            OPC_UA: lambda said: read_opc_ua(said, self._url),
        }
        return [read[said.name](said) for said in self.said]

    async def _compare(self) -> None:
        while True:
            self.compared.look(self.said)
            await asyncio.sleep(_COMPARE)

    def added_to(self, summary: Mapping[str, Any], hooked: float | None) -> dict[str, Any]:
        """The demo's summary with what the outlets told; ``hooked`` is the time of the fault, UTC s, if it came."""
        problems = [*summary["problems"], *self._problems(hooked)]
        told = {said.name: _told(said, hooked) for said in self.said}
        alike = {"frames": self.compared.frames, "health": self.compared.states}
        found = {"alike": alike, "unlike": dict(self.compared.unlike), "told": told, "left_out": dict(self.left_out)}
        return {**summary, "ok": not problems, "problems": problems, "outlets": found}

    def _problems(self, hooked: float | None) -> list[str]:
        """Sentences about outlets that told nothing, something else than the others, or not the fault."""
        silent = [f"{said.name} told no values: it {said.problem}" for said in self.said if not said.complete]
        unlike = [f"{n} times {name} was not the same in all outlets" for name, n in self.compared.unlike.items()]
        deaf = [f"the alarm was not seen in {said.name}" for said in self.said if hooked and said.heard is None]
        if not silent and not (self.compared.frames and self.compared.states):
            unlike.append("no frame, or no health message, was found in all outlets")
        return silent + unlike + deaf


def _told(said: Said, hooked: float | None) -> dict[str, Any]:
    late = None if said.heard is None or hooked is None else round(said.heard - hooked, 2)
    return {"alarm_after_s": late, "alarm": said.words or None, "problem": said.problem or None}


def _raise_of(tasks: list[asyncio.Task[None]]) -> None:
    """Raise the error of a task that failed."""
    for task in tasks:
        if task.done() and not task.cancelled() and (error := task.exception()) is not None:
            raise error
