"""What a Zenoh router takes to forward: processor time by message and by MB, over TCP and TLS, and memory a cell.

``costs``: messages of three sizes from four cells to one and to three readers; the constants of ``model.Forwarding``
are fitted to each run, and to all. ``cells``: what usual cells send, with the share of a core that the router took
beside what the constants say. ``wants`` says what is read: nothing, health, frames and results with health, everything.
The router is the Python binding in a process of its own; its Rust core is that of zenohd. Time is processor time, user
and kernel.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from capacity.bus import SITE, Topic, as_arguments, certificates, free_port
from capacity.children import Child, child
from capacity.figures import Figures, Numbers, computed, memory, repeated, spread
from capacity.model import Forwarding, Load, Traffic, fitted, most_cells

ARM: tuple[Topic, ...] = (
    Topic("raw/arm/rtde", 500.0, 3745),
    Topic("raw/board/power", 123.0, 1577),
    Topic("frame", 50.0, 5384),
    Topic("interval", 4.0, 605),
    Topic("health", 1.0, 3674),
)
"""Messages of a UR at 500 Hz with a power board, as ``record`` counts their sizes: a message a sample."""
WANTS: Mapping[str, tuple[str, ...]] = {
    "nothing": (),
    "health": ("health",),
    "frames, results, health": ("frame", "interval", "health"),
    "everything": ("**",),
}
SIZES, READERS, SENDERS, EACH = (300, 4000, 32_000), (1, 3), 4, 400.0
"""Bytes of a message, readers, cells and messages a second of each, of the runs that constants are fitted to."""
CELLS = (2, 8)
LINKED = 64
"""Sessions of which the memory is told."""
SETTLE = 1.0  # s


def traffic_of(topics: Sequence[Topic], want: str) -> Traffic:
    """What of a cell's messages goes to a router when that is wanted."""
    wanted = WANTS[want]
    kept = [t for t in topics if "**" in wanted or t.key.split("/")[0] in wanted]
    return Traffic(sum(t.rate for t in kept), sum(t.rate * t.size for t in kept))


def measure(seconds: float, repeats: int) -> Figures:
    """Figures over TCP and over TLS."""
    return {protocol: _over(protocol, seconds, repeats) for protocol in ("tcp", "tls")}


def _over(protocol: str, seconds: float, repeats: int) -> Figures:
    runs = [[_load(protocol, seconds, size, readers) for size in SIZES for readers in READERS] for _ in range(repeats)]
    costs = [fitted([load for load, _ in run]) for run in runs]
    whole = fitted([load for run in runs for load, _ in run])
    found: Figures = {"costs": spread([_shown(cost) for cost in costs]), "fitted": _shown(whole)}
    found["delivered"] = min(delivered for run in runs for _, delivered in run)
    found["cells"] = [
        {
            "cells": count,
            "want": want,
            **repeated(partial(_cells, protocol, seconds, count, want, whole), repeats),
        }
        for count, want in _scenes()
    ]
    found["most_cells"] = {
        want: most_cells(whole.cores(traffic_of(ARM, want), 1)) for want in WANTS if traffic_of(ARM, want).messages
    }
    found["memory"] = repeated(partial(_memory, protocol), repeats)
    return found


def _scenes() -> list[tuple[int, str]]:
    most = CELLS[-1]
    return [*((count, "everything") for count in CELLS), *((most, want) for want in WANTS if want != "everything")]


def _shown(cost: Forwarding) -> dict[str, float]:
    """Costs in µs a message and ms a MB."""
    told = asdict(cost)
    return {
        f"{name}_us" if "message" in name else f"{name}_ms": told[name] * (1e6 if "message" in name else 1e3)
        for name in told
    }


@contextmanager
def _plant(protocol: str) -> Iterator[tuple[Child, dict[str, Any]]]:
    """A router, and the link that leads to it."""
    with tempfile.TemporaryDirectory() as name:
        tls = {"tls": certificates(Path(name))} if protocol == "tls" else {}
        place = f"{protocol}/127.0.0.1:{free_port()}"
        with child("route", listen=[place], **tls) as router:
            yield router.ready(), {"connect": [place], **tls}


def _load(protocol: str, seconds: float, size: int, readers: int) -> tuple[Load, float]:
    """One load of messages of one size, and the share of them that every reader got."""
    topics = (Topic("raw/arm/rtde", EACH, size),)
    run = _run(protocol, seconds, SENDERS, topics, ("**",), readers)
    traffic = Traffic(run["messages"] / run["seconds"], run["bytes"] / run["seconds"])
    return Load(traffic, readers, run["cpu"] / run["seconds"]), run["delivered"]


def _cells(protocol: str, seconds: float, cells: int, want: str, cost: Forwarding) -> Numbers:
    """The router's share of a core with usual cells, measured and as the constants say."""
    run = _run(protocol, seconds, cells, ARM, WANTS[want], 1)
    share, wanted = run["cpu"] / run["seconds"], traffic_of(ARM, want)
    said = cost.cores(Traffic(cells * wanted.messages, cells * wanted.bytes), 1)
    per = max(run["forwarded"], 1.0)
    return {
        "core": share,
        "said": said,
        "ms_a_1000": 1e6 * run["cpu"] / per if run["forwarded"] else 0.0,
        "delivered": run["delivered"],
    }


def _run(
    protocol: str, seconds: float, cells: int, topics: Sequence[Topic], wants: Sequence[str], readers: int
) -> dict[str, float]:
    with ExitStack() as stack:
        router, link = stack.enter_context(_plant(protocol))
        publisher = stack.enter_context(child("publish", link=link, cells=cells, topics=as_arguments(topics)))
        keys = [f"cellwatt/{SITE}/*/{want}" for want in wants]
        reader = stack.enter_context(child("read", link=link, keys=keys, sessions=readers))
        publisher.ready(), reader.ready()
        time.sleep(SETTLE)
        reader.ask("begin")
        before = computed(router.pid)
        sent = publisher.ask(seconds)
        time.sleep(0.2)
        used = computed(router.pid) - before
        got = [sum(n for n, _ in told["topics"].values()) for told in reader.ask("tell")]
        expected = sum(int(seconds * t.rate) for t in topics if "**" in wants or t.key.split("/")[0] in wants) * cells
    return {**sent, "cpu": used, "forwarded": sum(got), "delivered": min(got) / expected if expected else 1.0}


def _memory(protocol: str) -> Numbers:
    """kB of the router for each session of a cell that is linked and silent, and MB without any."""
    with _plant(protocol) as (router, link):
        time.sleep(SETTLE)
        empty = memory(router.pid)
        with child("publish", link=link, cells=LINKED, topics=as_arguments(ARM)) as cells:
            cells.ready()
            time.sleep(SETTLE)
            full = memory(router.pid)
    return {"kB_a_cell": (full - empty) / LINKED / 1e3, "MB_empty": empty / 1e6}
