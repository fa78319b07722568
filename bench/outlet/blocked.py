"""A daemon as a user runs it, without outlets, with outlets whose servers hang, and with servers that answer.

A UR arm at 500 Hz, a power board, and a source that is not there, so that there is an alarm to tell; recorded, judged
by ``segment``, published over Zenoh. ``alone``: no more than that. ``blocked``: MQTT and InfluxDB with 10 rows a
second and a webhook for alarms, at ports that take connections and never read. ``answering``: Mosquitto, InfluxDB
(without it, a server that says 204 to everything), and a web server that says 204.

``lost`` are samples of the two devices that were dropped, and ``missed`` those or polls that never came; ``unrecorded``
what the record had no room for; ``frames_lost``, ``p50_ms`` and ``p99_ms`` are those of a Zenoh subscriber, from a
frame's time to its arrival. Shares are of a core, by process of the daemon; memory counts once what processes share.
``…_delivered`` is what each outlet has brought to its server since the daemon began.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from outlet.cell import CELL, SITE, daemon, emulated, status
from outlet.children import Child, child, free_port
from outlet.figures import Figures, computed
from outlet.loop import off_loop
from outlet.servers import DATABASE, INFLUXD, MOSQUITTO, influxd, mosquitto, saying_204, silent
from outlet.turns import in_turn

WAYS = ("alone", "blocked", "answering")
DELIVERED = {"mqtt": "rows sent", "historian": "received", "notify": "people: sent"}
"""What the health of each outlet counts when its server has taken something."""
SETTLED = 2.0
"""s from the subscriber's start to the first figure."""

Settings = Mapping[str, Any]


def measure(seconds: float, repeats: int) -> Figures:
    """Figures of each way, taken in turn."""
    if MOSQUITTO is None:
        return {"not measured": "mosquitto is not installed"}
    return in_turn({way: partial(_run, way, seconds) for way in WAYS}, repeats)


def _run(way: str, seconds: float) -> dict[str, float]:
    return asyncio.run(run(way, seconds))


async def run(way: str, seconds: float) -> dict[str, float]:
    """Figures of one daemon."""
    async with AsyncExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        settings: Settings = {}
        if way != "alone":
            servers = hanging() if way == "blocked" else answering(folder)
            settings = outlets(*await stack.enter_async_context(servers))
        devices = await stack.enter_async_context(emulated())
        absent = {"driver": "scpi_analyzer", "host": "127.0.0.1", "port": free_port()}
        place = f"tcp/127.0.0.1:{free_port()}"
        settings = {"sources": {**devices, "absent": absent}, "zenoh": {"listen": [place]}, **settings}
        await stack.enter_async_context(daemon(folder, settings))
        return await asyncio.to_thread(_window, place, list(devices), seconds)


@asynccontextmanager
async def hanging() -> AsyncIterator[tuple[int, str, str]]:
    """Servers that take connections and never read: the broker's port, addresses of InfluxDB and of a webhook."""
    async with off_loop(silent()) as broker, off_loop(silent()) as influx, off_loop(silent()) as web:
        yield broker.port, f"http://127.0.0.1:{influx.port}", f"http://127.0.0.1:{web.port}/alarms"


@asynccontextmanager
async def answering(folder: Path) -> AsyncIterator[tuple[int, str, str]]:
    """Servers that answer: the broker's port, addresses of InfluxDB and of a webhook."""
    async with AsyncExitStack() as stack:
        broker = await stack.enter_async_context(off_loop(mosquitto(folder)))
        web = await stack.enter_async_context(saying_204())
        called = f"http://127.0.0.1:{web}"
        influx = await stack.enter_async_context(off_loop(influxd(folder / "influx"))) if INFLUXD else called
        yield broker.port, influx, f"{called}/alarms"


def outlets(broker: int, influx: str, web: str) -> Settings:
    """Settings of the three outlets; attempts are short so that there are several in a run."""
    return {
        "mqtt": {"broker": f"mqtt://127.0.0.1:{broker}", "rate": "10 Hz"},
        "historian": {"influx": {"url": influx, "database": DATABASE, "rate": "10 Hz", "timeout": "2 s"}},
        "notify": {
            "timeout": "2 s",
            "retry": "1 s",
            "to": {"people": {"webhook": {"url": web}, "severity": "info", "group": "0 s"}},
        },
    }


def _window(place: str, devices: list[str], seconds: float) -> dict[str, float]:
    with child("zenoh_reader", place, f"cellwatt/{SITE}/{CELL}/frame") as reader:
        reader.ready()
        time.sleep(SETTLED)
        first = status(place)
        pids = _processes(first)
        reader.ask("begin")
        used, began = {part: computed(pid) for part, pid in pids.items()}, time.monotonic()
        time.sleep(seconds)
        lasted = time.monotonic() - began
        shares = {f"{part}_percent": 100 * (computed(pid) - used[part]) / lasted for part, pid in pids.items()}
        heard = _heard(reader)
        last = status(place)
        return {**lost(first, last, devices), **heard, **shares, **_memory(pids), **_delivered(last)}


def _processes(told: Settings) -> dict[str, int]:
    """Pids of the daemon by what each process is for."""
    pids = {part: int(each["pid"]) for part, each in told["processes"].items()}
    parent = psutil.Process(pids["tell"]).parent()
    assert parent is not None
    return {"supervise": parent.pid, **dict(sorted(pids.items()))}


def lost(first: Settings, last: Settings, devices: list[str]) -> dict[str, float]:
    """Samples lost and missed of some devices, and items that were not recorded, between two looks at health."""

    def total(told: Settings, what: str) -> float:
        return float(sum(sum(told["sources"][device][what].values()) for device in devices))

    drops = [float(sum(told["recorder"]["drops"].values())) for told in (first, last)]
    return {
        "lost": total(last, "dropped") - total(first, "dropped"),
        "missed": total(last, "missed") - total(first, "missed"),
        "unrecorded": drops[1] - drops[0],
    }


def _heard(reader: Child) -> dict[str, float]:
    told = reader.ask("tell")
    return {"frames_lost": float(told["lost"]), "p50_ms": told["p50_ms"], "p99_ms": told["p99_ms"]}


def _memory(pids: Mapping[str, int]) -> dict[str, float]:
    """MB, what several processes share counted once, of all of them and of the one that has the outlets."""
    each = {part: psutil.Process(pid).memory_full_info().pss / 1e6 for part, pid in pids.items()}
    return {"pss_mb": sum(each.values()), "tell_pss_mb": each["tell"]}


def _delivered(told: Settings) -> dict[str, float]:
    out = {}
    for name, what in DELIVERED.items():
        outlet = told["sinks"].get(name, {"counters": {}})
        out[f"{name}_delivered"] = float({**outlet, **outlet["counters"]}.get(what, 0))
    return out
