"""Outlets beside the plain client of the same protocol: throughput, loss, and what a server that hangs costs the loop.

python bench/outlets.py [mqtt metrics historian …] [--json] [--seconds 5] [--repeats 3]

Each outlet is one function below that gives its figures by name; without names all are measured. Where its server is
not installed, an outlet says so instead.

``mqtt``: rows of 60 channels as JSON to Mosquitto on this host, as fast as they go, counted by a subscriber in a
process of its own; ``plain`` publishes the same payloads with aiomqtt, one after the other (as its documentation shows)
or 64 at a time (as the outlet does). ``lost`` is the share of the offered rows that the subscriber did not get.
``lateness`` is that of a ticker of 1 kHz on the loop beside 50 rows a second, and the longest computing of one step of
that loop: without an outlet, with a broker that answers, and with one that takes the connection and then hangs.

``metrics``: answers a second of the endpoint for a cell of 16 sources and 60 channels to one client, beside what
prometheus-client's own server gives for as many series; bytes and processor time of one text.

``historian``: rows of 60 channels to Debian's InfluxDB, as fast as they go, beside the same lines posted with aiohttp
in the same batches; then what fills in from a record: rows a second into InfluxDB, and into a lake of Parquet files.
"""

from __future__ import annotations

import argparse
import asyncio
import getpass
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import aiomqtt
import numpy as np

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.errors import SinkError
from cellwatt.sinks.mqtt.settings import MqttSettings
from cellwatt.sinks.mqtt.sink import MqttSink
from cellwatt.ticker import Ticker

SITE, CELL = "bench", "cell"
CHANNELS, RATE = 60, 50.0
QUANTITIES = {"position": "rad", "velocity": "rad/s", "torque": "Nm", "current": "A", "temperature": "degC"}
LAYOUT = Layout(
    tuple(
        FrameChannel(f"arm.joint_{i // 5 + 1}.{quantity}", unit, "continuous", "linear")
        for i, (quantity, unit) in enumerate(list(QUANTITIES.items()) * (CHANNELS // len(QUANTITIES)))
    ),
    RATE,
)
BLOCK = 25
"""Frames that are offered at a time."""

Figures = dict[str, Any]


class View:
    """As much of a cell as an outlet needs, without a record."""

    site, cell = SITE, CELL
    folder = Path()
    session = 1
    journal = None

    def status(self) -> Mapping[str, Any]:
        return {"state": "green", "alarms": []}

    config = schema = status


def frames(first: int, count: int) -> Frames:
    numbers = np.arange(first, first + count)
    values = np.sin(numbers[:, None] * np.linspace(0.01, 0.02, CHANNELS))
    shape = values.shape
    time_ = 1_800_000_000_000_000_000 + numbers * LAYOUT.step
    return Frames(LAYOUT, first, time_, values, np.zeros(shape, np.uint8), np.zeros(shape, np.int64))


# what all outlets share -------------------------------------------------------------------------------


@contextmanager
def steps() -> Iterator[list[float]]:
    """The computing time of each step on the loop, s, which other processes of a busy PC do not lengthen."""
    found: list[float] = []
    run = asyncio.Handle._run  # type: ignore[attr-defined]

    def timed(handle: Any) -> None:
        began = time.thread_time()
        run(handle)
        found.append(time.thread_time() - began)

    asyncio.Handle._run = timed  # type: ignore[attr-defined]
    try:
        yield found
    finally:
        asyncio.Handle._run = run  # type: ignore[attr-defined]


async def ticks(seconds: float, each: Callable[[int], None]) -> Figures:
    """Lateness of a ticker of 1 kHz, also of beats that were merged, while ``each`` gets the number of each.

    ``step``: the longest computing of the loop between two looks at its sockets and timers.
    """
    late: list[float] = []
    with steps() as computing:
        await _tick(seconds, each, late)
    found = np.array(late)
    figures = {f"p{p:g}_us": round(float(np.percentile(found, p)), 1) for p in (50, 99, 99.9)}
    return {**figures, "most_us": round(float(found.max()), 1), "longest_step_us": round(1e6 * max(computing), 1)}


async def _tick(seconds: float, each: Callable[[int], None], late: list[float]) -> None:
    number = 0
    async with Ticker(1000.0) as ticker:
        async for tick in ticker:
            late += [1e6 * tick.lateness + 1000.0 * passed for passed in range(tick.merged + 1)]
            each(number)
            number += 1 + tick.merged
            if number >= seconds * 1000:
                break


async def served(sink: Any, work: Callable[[], Awaitable[Figures]]) -> Figures:
    """Do some work while a sink runs, again and again where it fails."""

    async def run() -> None:
        while True:
            with suppress(SinkError):
                await sink.run()
            await asyncio.sleep(0.5)

    task = asyncio.create_task(run())
    try:
        return await work()
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def until(condition: Callable[[], bool], pause: float = 0.01) -> None:
    """Look every ``pause`` s until a condition holds."""
    while not condition():  # noqa: ASYNC110 (what is measured tells nobody)
        await asyncio.sleep(pause)


def repeated(run: Callable[[], Figures], repeats: int) -> Figures:
    """Median of each figure over the runs, with the least and the most."""
    runs = [run() for _ in range(repeats)]
    return {
        name: {
            "median": round(statistics.median(r[name] for r in runs), 4),
            "least": round(min(r[name] for r in runs), 4),
            "most": round(max(r[name] for r in runs), 4),
        }
        for name in runs[0]
    }


# mqtt -------------------------------------------------------------------------------------------------

ROOT = f"cellwatt/{SITE}/{CELL}"
END = f"{ROOT}/end"


class Mosquitto:
    """A broker of this host on a port of its own."""

    def __init__(self, program: str, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        file = folder / f"mosquitto-{self.port}.conf"
        lines = ("allow_anonymous true", "persistence false", "max_queued_messages 0", "set_tcp_nodelay true")
        file.write_text("\n".join((f"listener {self.port} 127.0.0.1", f"user {getpass.getuser()}", *lines)) + "\n")
        self.process = subprocess.Popen([program, "-c", str(file)], stderr=subprocess.DEVNULL)
        while True:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), timeout=1):
                return
            time.sleep(0.02)

    def signal(self, number: signal.Signals) -> None:
        os.kill(self.process.pid, number)

    def end(self) -> None:
        self.process.kill()
        self.process.wait()


def consume(port: int) -> None:
    """Count rows until the last message, and say how many, and when the first and the last came."""
    asyncio.run(_consume(port))


async def _consume(port: int) -> None:
    count, first, last = 0, 0, 0
    async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.subscribe(f"{ROOT}/#", 1)
        print("ready", flush=True)
        async for message in client.messages:
            topic = str(message.topic)
            if topic == END:
                break
            if topic == f"{ROOT}/frame":
                last = time.monotonic_ns()
                first = first or last
                count += 1
    print(json.dumps({"count": count, "first": first, "last": last}))


@contextmanager
def consumer(port: int) -> Iterator[Callable[[], Figures]]:
    command = [sys.executable, __file__, "--consume", str(port)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    child.stdout.readline()
    try:
        yield lambda: json.loads(child.communicate(timeout=120)[0])
    finally:
        child.kill()
        child.wait()


def mqtt(seconds: float, repeats: int) -> Figures:
    """Figures of the outlet over MQTT."""
    program = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    if program is None:
        return {"not measured": "mosquitto is not installed"}
    with tempfile.TemporaryDirectory() as folder:
        broker = Mosquitto(program, Path(folder))
        try:
            return {**_mqtt_rows(broker, seconds, repeats), **_mqtt_lateness(broker, seconds)}
        finally:
            broker.end()


def _mqtt_sink(port: int, qos: int) -> MqttSink:
    told = {"broker": f"mqtt://127.0.0.1:{port}", "rate": f"{RATE:g} Hz", "qos": {"frame": qos}, "queue": 4096}
    return MqttSink("mqtt", MqttSettings.model_validate(told), View())  # type: ignore[arg-type]


def _mqtt_rows(broker: Mosquitto, seconds: float, repeats: int) -> Figures:
    found: Figures = {"payload_bytes": len(_payloads(1)[0])}
    ways = {
        f"{name}_qos_{qos}": (lambda give=give, qos=qos: _through(broker.port, give, qos, seconds))
        for qos in (1, 0)
        for name, give in {"cellwatt": _flood, "plain_one_by_one": _plain(1), "plain_64_at_a_time": _plain(64)}.items()
    }
    for name, run in ways.items():
        found[name] = repeated(run, repeats)
    return found


Give = Callable[[int, int, float], Awaitable[int]]
"""Sends rows to a port with a quality of service for some seconds; gives how many."""


def _through(port: int, give: Give, qos: int, seconds: float) -> Figures:
    """Rows a second at a subscriber, and the share that it did not get."""
    with consumer(port) as finish:
        given = asyncio.run(_given(port, give, qos, seconds))
        found = finish()
    span = (found["last"] - found["first"]) / 1e9
    return {"rows_per_s": (found["count"] - 1) / span, "lost": 1 - found["count"] / given}


async def _given(port: int, give: Give, qos: int, seconds: float) -> int:
    given = await give(port, qos, seconds)
    async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
        await client.publish(END, b"", 1)
    return given


async def _flood(port: int, qos: int, seconds: float) -> int:
    """Offer frames to the outlet, as fast as its queue takes them."""
    sink = _mqtt_sink(port, qos)
    blocks = [frames(BLOCK * i, BLOCK) for i in range(40)]
    sequence = 0

    async def work() -> Figures:
        nonlocal sequence
        await until(lambda: sink._outbox.serving)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            block = blocks[(sequence // BLOCK) % len(blocks)]
            sink.offer(Frames(LAYOUT, sequence, block.time, block.values, block.quality, block.bound))
            sequence += BLOCK
            await until(lambda: len(sink._outbox.rows) < 200, 0.0)
        await until(lambda: sink.account.counters["rows sent"] == sequence)
        return {}

    await served(sink, work)
    return sequence


def _payloads(count: int) -> list[bytes]:
    """Payloads as the outlet makes them."""
    from cellwatt.sinks.mqtt.message import Labels
    from cellwatt.sinks.mqtt.plain import PlainFormat
    from cellwatt.sinks.selection import Picker

    settings = MqttSettings(rate=RATE)
    format_, picker = PlainFormat(settings, SITE, CELL), Picker(settings, LAYOUT)
    format_.label(Labels(picker.units, dict.fromkeys(picker.units, "continuous")), 0)
    return [format_.row(row, False, 0)[0].payload for row in picker.rows(frames(0, count))]


def _plain(at_a_time: int) -> Give:
    """The client alone, with payloads that are there already."""

    async def give(port: int, qos: int, seconds: float) -> int:
        payloads, given = _payloads(1000), 0
        async with aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5) as client:
            client.pending_calls_threshold = 1000
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                each = [
                    client.publish(f"{ROOT}/frame", payloads[(given + i) % len(payloads)], qos)
                    for i in range(at_a_time)
                ]
                await asyncio.gather(*each)
                given += at_a_time
        return given

    return give


def _mqtt_lateness(broker: Mosquitto, seconds: float) -> Figures:
    found = {"lateness_without": asyncio.run(_lateness(None, None, seconds))}
    found["lateness_with_broker"] = asyncio.run(_lateness(broker, None, seconds))
    found["lateness_broker_hangs"] = asyncio.run(_lateness(broker, signal.SIGSTOP, seconds))
    return found


async def _lateness(broker: Mosquitto | None, how: signal.Signals | None, seconds: float) -> Figures:
    if broker is None:
        return await ticks(seconds, lambda number: None)
    sink = _mqtt_sink(broker.port, 1)

    made = 0

    def each(number: int) -> None:
        nonlocal made
        if number // 20 > made:
            made = number // 20
            sink.offer(frames(made, 1))

    async def work() -> Figures:
        await until(lambda: sink._outbox.serving)
        await asyncio.sleep(0.2)
        if how is not None:
            broker.signal(how)
        try:
            return await ticks(seconds, each)
        finally:
            broker.signal(signal.SIGCONT)

    return await served(sink, work)


# metrics ----------------------------------------------------------------------------------------------


def metrics(seconds: float, repeats: int) -> Figures:
    """Figures of the endpoint for Prometheus."""
    return repeated(lambda: asyncio.run(_metrics(seconds)), repeats)


def _health(sources: int) -> Figures:
    """Health of a cell as its daemon tells it."""
    source = {
        "state": "ok", "expected": 10**6, "received": 10**6, "missed": {"gap": 4}, "dropped": {}, "residue": 0,
        "counters": {"event connected": 1, "reconnects": 2},
        "streams": {"rtde": {"nominal_hz": 500.0, "rate_hz": 500.0}},
        "clocks": {"rtde": {"bound_ns": 10**6, "resets": 0}},
    }  # fmt: skip
    process = {"pid": 1, "down": False, "silent_s": 0.1, "restarts": 0, "cpu_s": 1.0, "loop_lag_ms": 0.1}
    parts = ("collect", "align", "judge segment", "judge power", "tell")
    return {
        "state": "green",
        "sources": {f"arm_{n}": source for n in range(sources)},
        "processes": dict.fromkeys(parts, process),
        "alarms": [],
    }


async def _metrics(seconds: float) -> Figures:
    from cellwatt.sinks.metrics.serving import FRESH
    from cellwatt.sinks.metrics.settings import MetricsSettings
    from cellwatt.sinks.metrics.sink import MetricsSink

    sink = MetricsSink("metrics", MetricsSettings(listen="127.0.0.1:0"), View())  # type: ignore[arg-type]
    sink.health(_health(16))
    sink.offer(frames(0, 1))

    async def work() -> Figures:
        from cellwatt.sinks.metrics.exposition import CellCollector, exposed

        while sink.url is None:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        collector = CellCollector(sink._meter, {})
        began = time.thread_time()
        for _ in range(20):
            text, _ = exposed(collector, "application/openmetrics-text")
        cost = (time.thread_time() - began) / 20
        series = sum(line[:1] != b"#" for line in text.splitlines())
        ours = await _answers(f"{sink.url}/metrics", seconds)
        with _plain_server(series) as plain:
            theirs = await _answers(plain, seconds)
        return {
            "series": series, "bytes": len(text), "text_ms": 1e3 * cost, "fresh_s": FRESH,
            "answers_per_s": ours, "plain_answers_per_s": theirs,
        }  # fmt: skip

    return await served(sink, work)


async def _answers(url: str, seconds: float) -> float:
    import aiohttp

    headers, count = {"Accept": "application/openmetrics-text"}, 0
    async with aiohttp.ClientSession(headers=headers) as session:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            async with session.get(url) as answer:
                await answer.read()
            count += 1
    return count / seconds


@contextmanager
def _plain_server(series: int) -> Iterator[str]:
    """prometheus-client's own server with as many series."""
    from prometheus_client import CollectorRegistry, Counter, start_http_server

    registry = CollectorRegistry()
    counter = Counter("samples", "Samples.", ["source"], registry=registry)
    for n in range(series):
        counter.labels(f"arm_{n}").inc()
    server, thread = start_http_server(0, "127.0.0.1", registry)
    try:
        yield f"http://127.0.0.1:{server.server_port}/metrics"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


# historian --------------------------------------------------------------------------------------------

HISTORY = 600
"""s of frames in the record that is filled in from."""


def historian(seconds: float, repeats: int) -> Figures:
    """Figures of the historian: InfluxDB and a lake."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "record"
        record.mkdir()
        _recorded(record)
        found: Figures = {"lake": repeated(lambda: _lake(record, Path(folder)), repeats)}
        program = shutil.which("influxd")
        if program is None:
            return {**found, "influx": "not measured: influxd is not installed"}
        with _influxd(program, Path(folder) / "influx") as url:
            ways = {"influx": _influx, "plain_posts": _posts, "filled_in": _filled(record)}
            return found | {
                name: repeated(lambda way=way: asyncio.run(way(url, seconds)), repeats) for name, way in ways.items()
            }


def _recorded(folder: Path) -> None:
    """A record of ten minutes of frames, a chunk a second."""
    from cellwatt.record import Header
    from cellwatt.record.encoder import Encoder
    from cellwatt.record.header import FileName
    from cellwatt.record.openfile import OpenFile

    session = 1_800_000_000_000_000_000
    file = OpenFile(folder / str(FileName(session, 1, CELL)), Header(SITE, CELL, session, number=1))
    encoder = Encoder(file)
    for second in range(HISTORY):
        encoder.add(frames(second * round(RATE), round(RATE)))
        file.write_chunk()
    file.finish()
    file.publish()


def _lake(record: Path, folder: Path) -> Figures:
    """Rows a second into Parquet at the rate of the frames, and bytes of a row."""
    from cellwatt.sinks.historian.exporting import Export
    from cellwatt.sinks.historian.settings import LakeSettings
    from cellwatt.sinks.historian.store import FolderStore

    with tempfile.TemporaryDirectory(dir=folder) as lake:
        settings = LakeSettings(folder=lake, rate=RATE, results=False)
        began = time.monotonic()
        rows = sum(done.rows for done in Export(record, SITE, CELL, settings, FolderStore(Path(lake))).run())
        size = sum(path.stat().st_size for path in Path(lake).rglob("*.parquet"))
        return {"rows_per_s": rows / (time.monotonic() - began), "bytes_per_row": size / rows, "rows": rows}


@contextmanager
def _influxd(program: str, folder: Path) -> Iterator[str]:
    import urllib.request

    folder.mkdir()
    ports = []
    for _ in range(2):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            ports.append(free.getsockname()[1])
    file = folder / "influxdb.conf"
    file.write_text(
        f'reporting-disabled = true\nbind-address = "127.0.0.1:{ports[0]}"\n[meta]\ndir = "{folder}/meta"\n'
        f'[data]\ndir = "{folder}/data"\nwal-dir = "{folder}/wal"\n[monitor]\nstore-enabled = false\n'
        f'[http]\nbind-address = "127.0.0.1:{ports[1]}"\nlog-enabled = false\n'
    )
    url = f"http://127.0.0.1:{ports[1]}"
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([program, "-config", str(file)], stdout=quiet, stderr=quiet)
    try:
        while True:
            with suppress(OSError):
                urllib.request.urlopen(f"{url}/query?q=CREATE+DATABASE+bench", data=b"").close()
                break
            time.sleep(0.05)
        yield url
    finally:
        process.kill()
        process.wait()


def _influx_settings(url: str) -> Any:
    from cellwatt.sinks.historian.settings import InfluxSettings

    return InfluxSettings(url=url, database="bench", rate=RATE, every=0.01, queue=100_000)


async def _influx(url: str, seconds: float) -> Figures:
    """Rows a second through the outlet, offered as fast as they are taken."""
    from cellwatt.sinks.historian.settings import HistorianSettings
    from cellwatt.sinks.historian.sink import HistorianSink

    settings = HistorianSettings(influx=_influx_settings(url))
    sink = HistorianSink("historian", settings, View())  # type: ignore[arg-type]
    assert sink._influx is not None
    offered = 0

    async def work() -> Figures:
        nonlocal offered
        began = time.monotonic()
        while time.monotonic() < began + seconds:
            sink.offer(frames(offered, BLOCK))
            offered += BLOCK
            while len(sink._influx._items) > 40:  # type: ignore[union-attr]  # noqa: ASYNC110
                await asyncio.sleep(0)
        while sink.account.received < offered - 1:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        return {"rows_per_s": sink.account.received / (time.monotonic() - began)}

    return await served(sink, work)


async def _posts(url: str, seconds: float) -> Figures:
    """The same lines, made before, posted one batch after the other."""
    import gzip

    import aiohttp

    from cellwatt.sinks.historian.line_protocol import row_line
    from cellwatt.sinks.selection import Picker

    settings = _influx_settings(url)
    rows = list(Picker(settings, LAYOUT).rows(frames(0, settings.batch)))
    body = "\n".join(row_line("plain", {"cell": CELL}, row) for row in rows).encode()
    count, began = 0, time.monotonic()
    async with aiohttp.ClientSession(headers={"Content-Encoding": "gzip"}) as session:
        while time.monotonic() < began + seconds:
            packed = await asyncio.to_thread(gzip.compress, body, 5)
            async with session.post(f"{url}/write?db=bench&precision=ns", data=packed) as answer:
                answer.raise_for_status()
            count += len(rows)
    return {"rows_per_s": count / (time.monotonic() - began)}


def _filled(record: Path) -> Callable[[str, float], Awaitable[Figures]]:
    """Rows a second from the record into InfluxDB."""

    async def run(url: str, _: float) -> Figures:
        from cellwatt.account import Account
        from cellwatt.sinks.historian.client import Client
        from cellwatt.sinks.historian.filling import lines_of
        from cellwatt.sinks.historian.sending import Sender

        settings, account = _influx_settings(url), Account()
        start, step, began = 1_800_000_000_000_000_000, 6 * 10**9, time.monotonic()
        async with Client(settings) as client:
            for at in range(start, start + HISTORY * 10**9, step):
                lines = await asyncio.to_thread(lines_of, record, CELL, settings, {"cell": CELL}, (at, at + step))
                await Sender(client, account, None).send(lines)
        return {"rows_per_s": account.received / (time.monotonic() - began)}

    return run


OUTLETS: Mapping[str, Callable[[float, int], Figures]] = {"mqtt": mqtt, "metrics": metrics, "historian": historian}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("outlets", nargs="*", choices=[[], *OUTLETS])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--consume", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.consume:
        consume(options.consume)
        return
    found = {name: OUTLETS[name](options.seconds, options.repeats) for name in options.outlets or OUTLETS}
    if options.json:
        print(json.dumps(found))
        return
    for name, figures in found.items():
        for what, figure in figures.items():
            print(name, what, json.dumps(figure))


if __name__ == "__main__":
    main()
