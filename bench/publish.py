"""Publication over Zenoh beside bare Zenoh: latency and throughput from one process to another on one host.

python bench/publish.py [--json] [--seconds 5] [--repeats 5]

Latency: 8 sources × 500 Hz × 60 channels, one sample a message; from ``offer`` (cellwatt) or ``put`` (bare Zenoh, a
payload of the same size from the same event loop) until the consumer has it, both clocks CLOCK_MONOTONIC. cellwatt is
measured at a plain Zenoh consumer, and at ``Subscriber``, decoded and in order. ``direct`` is the alternative that we
do not use: encode and put on the event loop. ``*_on_loop`` is how long the event loop is held by each sample.
Throughput: blocks of 100 samples as fast as they go, counted at the consumer.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import socket
import statistics
import subprocess
import sys
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from cellwatt import Batch, Channel, Stream
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.outlets.zenoh.encode import encode_batch
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.subscriber import Subscriber
from cellwatt.ticker import Ticker

SITE, CELL = "bench", "cell"
SOURCES, RATE, CHANNELS = 8, 500.0, 60
BLOCK = 100
QUANTITIES = ("position", "velocity", "torque", "current", "temperature", "voltage")
STREAM = Stream(
    "samples",
    tuple(Channel(f"joint_{i // 6 + 1}.{QUANTITIES[i % 6]}_{i}", "1") for i in range(CHANNELS)),
    RATE,
    "device",
)
RAW = f"cellwatt/{SITE}/{CELL}/raw"


class View:
    """As much of a cell as publication needs, with a record in memory for single samples."""

    site, cell = SITE, CELL
    session = 1
    journal = None

    def __init__(self) -> None:
        self.recorded: dict[str, list[Batch]] = {f"arm_{i}": [] for i in range(SOURCES)}

    def status(self) -> dict[str, Any]:
        return {}

    config = schema = status

    def recordings(self) -> list[Any]:
        return []

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> list[Batch]:
        return self.recorded[source][first : first + count]

    def frame_history(self, session: int, first: int, count: int) -> list[Any]:
        return []

    def result_history(self, series: str, session: int, first: int, count: int) -> list[Any]:
        return []


def make_batch(source: int, sequence: int, n: int, arrival: int = 0) -> Batch:
    times = np.arange(sequence, sequence + n)
    return Batch(
        source=f"arm_{source}",
        stream=STREAM,
        sequence=sequence,
        arrival=arrival,
        time=times,
        bound=times,
        values=np.full((n, CHANNELS), 1.5),
        quality=np.zeros(n, np.uint8),
        device_time=times,
    )


# the consumer's process --------------------------------------------------------------------------------


def consume(kind: str, endpoint: str) -> None:
    """Receive until the input ends, then say what was measured."""
    link = LinkSettings(mode="client", connect=(endpoint,))
    offered, took = array("q"), array("q")  # ns; no objects that make the garbage collector work
    values = 0
    last = 0

    def take(arrival: int, samples: int) -> None:
        nonlocal values, last
        last = time.monotonic_ns()
        offered.append(arrival)
        took.append(last - arrival)
        values += samples * CHANNELS

    def on_sample(sample: Any) -> None:
        mark = Mark.decode(sample.attachment.to_bytes(), sample.payload.to_bytes())
        take(mark.arrival, mark.count)

    if kind == "subscriber":
        with Subscriber(SITE, CELL, link, want=("raw",)) as cell:
            print("ready", flush=True)
            stopper = threading.Thread(target=lambda: (sys.stdin.read(), cell.close()))
            stopper.start()
            for message in cell:
                take(message.content.arrival, message.count)
            stopper.join()
    else:
        with open_session(link) as session:
            session.declare_subscriber(f"{RAW}/**", on_sample)
            print("ready", flush=True)
            sys.stdin.read()
    print(json.dumps({"offered": offered.tolist(), "took": took.tolist(), "values": values, "last": last}))


@contextmanager
def consumer(kind: str, endpoint: str) -> Iterator[Callable[[], dict[str, Any]]]:
    command = [sys.executable, __file__, "--consume", kind, "--endpoint", endpoint]
    child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    child.stdout.readline()
    try:
        yield lambda: json.loads(child.communicate("", 60)[0])
    finally:
        child.kill()
        child.wait()


def free_endpoint() -> str:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{s.getsockname()[1]}"


# the publisher's process -------------------------------------------------------------------------------

Give = Callable[[Batch], None]


@contextmanager
def bare(endpoint: str, payload: bytes | None) -> Iterator[Give]:
    """Puts on the event loop: always the same payload (bare Zenoh), or, without one, the encoded batch (direct)."""
    import zenoh

    with open_session(LinkSettings(listen=(endpoint,))) as session:
        options = {"congestion_control": zenoh.CongestionControl.BLOCK, "express": True}
        publishers = {
            f"arm_{i}": session.declare_publisher(f"{RAW}/arm_{i}/samples", **options) for i in range(SOURCES)
        }

        def give(batch: Batch) -> None:
            content = payload or encode_batch(batch)
            mark = Mark(1, batch.sequence, len(batch), batch.arrival).encode(content)
            publishers[batch.source].put(content, attachment=mark)

        yield give


async def pace(give: Give, seconds: float, first: int) -> tuple[int, list[int]]:
    """Give each source's sample at 500 Hz, the sources spread over the period.

    What fell due while the loop slept is given in one go and stamped with the time the loop woke, as if read from
    sockets then. Gives the monotonic time of the beginning and for how long each ``give`` held the loop, ns.
    """
    held: list[int] = []
    begun = 0
    total = int(seconds * RATE * SOURCES)
    async with Ticker(RATE * SOURCES) as ticker:
        async for _ in ticker:
            woke = time.monotonic_ns()
            begun = begun or woke
            due = min(total, int((woke - begun) * 1e-9 * RATE * SOURCES))
            for i in range(len(held), due):
                batch = make_batch(i % SOURCES, first + i // SOURCES, 1, woke)
                before = time.monotonic_ns()
                give(batch)
                held.append(time.monotonic_ns() - before)
            if due == total:
                break
    await asyncio.sleep(0.3)
    return begun, held


async def with_outlet(endpoint: str, view: View, work: Callable[[ZenohOutlet], Any]) -> Any:
    outlet = ZenohOutlet("zenoh", ZenohSettings(listen=(endpoint,), queue=4096), view)
    task = asyncio.create_task(outlet.run())
    try:
        return await work(outlet)
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


def latency(way: str, seconds: float) -> dict[str, float]:
    """Figures of one run, µs."""
    endpoint = free_endpoint()
    kind = "subscriber" if way == "subscriber" else "plain"

    async def measure(give: Give) -> tuple[int, list[int], dict[str, Any]]:
        context = consumer(kind, endpoint)
        finish = await asyncio.to_thread(context.__enter__)
        try:
            for i in range(SOURCES):  # imports, schemas, routes
                give(make_batch(i, 0, 1))
            await asyncio.sleep(1.5)
            begun, held = await pace(give, seconds, 1)
            return begun, held, await asyncio.to_thread(finish)
        finally:
            context.__exit__(None, None, None)

    if way in ("zenoh", "direct"):
        with bare(endpoint, encode_batch(make_batch(0, 0, 1)) if way == "zenoh" else None) as give:
            begun, held, found = asyncio.run(measure(give))
    else:
        view = View()

        def recorded_and_offered(outlet: ZenohOutlet) -> Any:
            def give(batch: Batch) -> None:
                view.recorded[batch.source].append(batch)
                outlet.offer(batch)

            return measure(give)

        begun, held, found = asyncio.run(with_outlet(endpoint, view, recorded_and_offered))
    arrived = np.array(found["took"])[np.array(found["offered"]) >= begun] / 1e3
    return {
        "p50": float(np.percentile(arrived, 50)),
        "p99": float(np.percentile(arrived, 99)),
        "p99.9": float(np.percentile(arrived, 99.9)),
        "on_loop_p50": float(np.percentile(held, 50)) / 1e3,
        "on_loop_p99": float(np.percentile(held, 99)) / 1e3,
        "delivered": found["values"] / CHANNELS / (SOURCES + int(seconds * RATE * SOURCES)),
    }


def throughput(way: str, seconds: float) -> dict[str, float]:
    """Million channel-values a second at the consumer."""
    endpoint = free_endpoint()

    async def flood(give: Give, waiting: Callable[[], int]) -> float:
        context = consumer("plain", endpoint)
        finish = await asyncio.to_thread(context.__enter__)
        try:
            start = time.monotonic_ns()
            sequences = [0] * SOURCES
            i = 0
            while time.monotonic_ns() - start < seconds * 1e9:
                give(make_batch(i % SOURCES, sequences[i % SOURCES], BLOCK))
                sequences[i % SOURCES] += BLOCK
                i += 1
                for _ in iter(lambda: waiting() > 64, False):
                    await asyncio.sleep(0)
            await asyncio.sleep(0.5)
            found = await asyncio.to_thread(finish)
        finally:
            context.__exit__(None, None, None)
        return found["values"] / ((found["last"] - start) / 1e9) / 1e6

    if way == "zenoh":
        with bare(endpoint, encode_batch(make_batch(0, 0, BLOCK))) as give:
            return {"Mvalues_per_s": asyncio.run(flood(give, lambda: 0))}
    return {
        "Mvalues_per_s": asyncio.run(
            with_outlet(endpoint, View(), lambda outlet: flood(outlet.offer, lambda: len(outlet._outbox)))
        )
    }


def repeated(run: Callable[[], dict[str, float]], repeats: int) -> dict[str, Any]:
    """Median of each figure over the runs, with the least and the most."""
    runs = [run() for _ in range(repeats)]
    return {
        name: {
            "median": round(statistics.median(r[name] for r in runs), 3),
            "least": round(min(r[name] for r in runs), 3),
            "most": round(max(r[name] for r in runs), 3),
        }
        for name in runs[0]
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--consume", help=argparse.SUPPRESS)
    parser.add_argument("--endpoint", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.consume:
        consume(options.consume, options.endpoint)
        return
    found: dict[str, Any] = {
        "setup": {"sources": SOURCES, "rate_Hz": RATE, "channels": CHANNELS, "seconds": options.seconds},
        "payload_bytes": len(encode_batch(make_batch(0, 0, 1))),
        "repeats": options.repeats,
    }
    for way in ("cellwatt", "subscriber", "direct", "zenoh"):
        found[f"latency_{way}_us"] = repeated(lambda w=way: latency(w, options.seconds), options.repeats)
    for way in ("cellwatt", "zenoh"):
        found[f"throughput_{way}"] = repeated(lambda w=way: throughput(w, options.seconds), options.repeats)
    if options.json:
        print(json.dumps(found))
        return
    for name, figures in found.items():
        print(name, json.dumps(figures))


if __name__ == "__main__":
    main()
