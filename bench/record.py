"""The recorder beside the ``mcap`` library's own writer: rate, size, loss at ``kill -9``, time of recovery.

    python bench/record.py --json

Both sides record the same 60 channels of an emulated arm, pinned to one core: ours as protobuf through
``Recorder``, the peer as one JSON message a sample through ``mcap.writer.Writer`` with its defaults. Rates
are per second of that core's time (all threads, kernel included), so that neighbours do not count. The
killed processes record 500 samples a second in real time and say each number before they hand it over.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from cellwatt import Batch, Channel, Stream
from cellwatt.emulation import ArmSignals
from cellwatt.record import Header, Recorder, Recording, RecordSettings, recover
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import PART
from cellwatt.record.openfile import OpenFile

CHANNELS = 60
RATE = 500.0
PERIOD = 2_000_000
SESSION = 1_795_255_163_000_000_000
STREAM = Stream("rtde", tuple(Channel(f"value_{i}", "1") for i in range(CHANNELS)), RATE, "device")
HEADER = Header("bench", "cell", SESSION, streams={"arm": (STREAM,)})


def values(n: int) -> np.ndarray:
    """(n, 60) of what an arm at work gives: its 41 channels and 19 of them again with other noise."""
    t = np.arange(n) / RATE
    columns = [*ArmSignals(seed=0).at(t).values(), *ArmSignals(seed=1).at(t).values()]
    return np.column_stack(columns[:CHANNELS])


def batches(table: np.ndarray, size: int, source: str = "arm") -> Iterator[Batch]:
    for first in range(0, len(table) - size + 1, size):
        sequence = np.arange(first, first + size)
        stamp = SESSION + sequence * PERIOD
        bound, quality = np.full(size, 50_000), np.zeros(size, np.uint8)
        arrival = int(stamp[-1]) + 400_000
        yield Batch(source, STREAM, first, arrival, stamp, bound, table[first : first + size], quality, stamp)


async def ours(table: np.ndarray, size: int) -> dict[str, float]:
    """As fast as the recorder takes it, caller and writer thread on one core."""
    with tempfile.TemporaryDirectory() as folder:
        made = list(batches(table, size))
        recorder = Recorder(RecordSettings(folder=Path(folder), queue=8e6), HEADER)
        recorder.start()
        begin = cpu()
        for batch in made:
            while not recorder.put(batch):
                await asyncio.to_thread(recorder.flush, 10)
        await recorder.close()
        seconds = cpu() - begin
        n = len(made) * size
        recording = Recording.open(Path(folder))
        stored = sum(path.stat().st_size for path in recording.paths)
        assert len(recording.batches("arm", "rtde")) == n
    return {"samples_per_s": n / seconds, "values_per_s": n * CHANNELS / seconds, "bytes_per_sample": stored / n}


def json_messages(table: np.ndarray) -> Iterator[tuple[int, bytes]]:
    names = STREAM.names
    for i, row in enumerate(table):
        stamp = SESSION + i * PERIOD
        yield stamp, json.dumps({"time": stamp, **dict(zip(names, row.tolist(), strict=True))}).encode()


def json_writer(stream: IO[bytes]) -> tuple[Writer, int]:
    properties = {name: {"type": "number"} for name in STREAM.names}
    writer = Writer(stream)
    writer.start()
    described = json.dumps({"type": "object", "properties": properties}).encode()
    schema = writer.register_schema("sample", "jsonschema", described)
    return writer, writer.register_channel("/raw", "json", schema)


def peer(table: np.ndarray) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "peer.mcap"
        stream = path.open("wb")
        writer, channel = json_writer(stream)
        begin = cpu()
        for n, (stamp, data) in enumerate(json_messages(table)):
            writer.add_message(channel, stamp, data, stamp, n)
        writer.finish()
        seconds = cpu() - begin
        stream.close()
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
            assert summary is not None and summary.statistics is not None
            assert summary.statistics.message_count == len(table)
        stored = path.stat().st_size
    n = len(table)
    return {"samples_per_s": n / seconds, "values_per_s": n * CHANNELS / seconds, "bytes_per_sample": stored / n}


async def real_time(table: np.ndarray, sources: int, seconds: float, record: bool) -> float:
    """CPU seconds a second of ``sources`` streams at 500 Hz, one sample a batch."""
    with tempfile.TemporaryDirectory() as folder:
        made = [list(batches(table, 1, f"arm_{i}")) for i in range(sources)]
        recorder = Recorder(RecordSettings(folder=Path(folder)), HEADER)
        recorder.start()
        used, begin, number = cpu(), time.monotonic(), 0
        while (now := time.monotonic() - begin) < seconds:
            while number < now * RATE:
                for stream in made:
                    if record:
                        assert recorder.put(stream[number])
                number += 1
            await asyncio.sleep(0.002)
        spent = cpu() - used
        await recorder.close()
    return spent / seconds


def cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def paced(n: int) -> Iterator[int]:
    begin = time.monotonic()
    for number in range(n):
        while time.monotonic() - begin < number / RATE:
            time.sleep(0.0005)
        os.write(1, b"%d\n" % number)
        yield number


async def child_ours(folder: Path) -> None:
    recorder = Recorder(RecordSettings(folder=folder), HEADER)
    made = list(batches(values(5000), 1))
    recorder.start()
    for number in paced(len(made)):
        recorder.put(made[number])


def child_peer(folder: Path) -> None:
    stream = (folder / "peer.mcap").open("wb")
    writer, channel = json_writer(stream)
    made = list(json_messages(values(5000)))
    for number in paced(len(made)):
        stamp, data = made[number]
        writer.add_message(channel, stamp, data, stamp, number)


def killed(kind: str, seed: int) -> int:
    """Samples that a killed process had been given and no file holds."""
    with tempfile.TemporaryDirectory() as folder:
        until = random.Random(seed).randint(500, 2000)
        command = [sys.executable, __file__, "--child", kind, folder]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if int(line) >= until:
                    break
            process.kill()
            rest = [int(line) for line in process.stdout.read().splitlines() if line]
        said = (rest[-1] if rest else until) + 1
        return said - (stored_ours(Path(folder)) if kind == "ours" else stored_peer(Path(folder)))


def stored_ours(folder: Path) -> int:
    for part in folder.glob(f"*{PART}"):
        recover(part)
    return len(Recording.open(folder).batches("arm", "rtde")) if any(folder.glob("*.mcap")) else 0


def stored_peer(folder: Path) -> int:
    stored = 0
    with (folder / "peer.mcap").open("rb") as file:
        try:
            for record in StreamReader(file).records:
                stored += type(record).__name__ == "Message"
        except Exception:  # any of several at a torn tail
            pass
    return stored


def loss(kind: str, kills: int) -> dict[str, float]:
    lost = sorted(killed(kind, seed) for seed in range(kills))
    ms = [n / RATE * 1e3 for n in lost]
    return {
        "kills": kills,
        "median_ms": float(np.median(ms)),
        "p90_ms": float(np.percentile(ms, 90)),
        "worst_ms": ms[-1],
    }


def recovery(size: float) -> dict[str, float]:
    """Repair of a file of ``size`` bytes written at 500 Hz, one sample a batch, a chunk every 50 ms, then torn."""
    with tempfile.TemporaryDirectory() as folder:
        file = OpenFile(Path(folder) / "cell_20261121T095923_290084047Z_000001.mcap", HEADER)
        encoder, table, n = Encoder(file), values(50_000), 0
        while file.size < size:
            for batch in batches(table, 1):
                encoder.add(batch)
                n += 1
                if n % 25 == 0:
                    file.write_chunk()
                    if file.size >= size:
                        break
        file.release()
        with file.part.open("ab") as torn:
            torn.write(b"\x06torn")
            torn.flush()
            # A crash leaves at most a second of it unsynced; the rest is not the repair's to wait for.
            os.fsync(torn.fileno())
        begin, used = time.perf_counter(), cpu()
        report = recover(file.part)
        seconds, used = time.perf_counter() - begin, cpu() - used
        assert report is not None and report.messages == n // 25 * 25, report
    return {"bytes": size, "samples": n, "seconds": seconds, "cpu_seconds": used}


def run(kills: int) -> dict[str, Any]:
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    table = values(30_000)
    figures: dict[str, Any] = {
        "recorder_batches_of_1": asyncio.run(ours(table, 1)),
        "recorder_batches_of_10": asyncio.run(ours(table, 10)),
        "recorder_batches_of_50": asyncio.run(ours(table, 50)),
        "mcap_json_writer": peer(table[:10_000]),
    }
    idle = asyncio.run(real_time(table, 8, 5.0, record=False))
    figures["cpu_of_8_streams_at_500_hz"] = asyncio.run(real_time(table, 8, 5.0, record=True)) - idle
    figures["recovery_10_min_at_500_hz"] = recovery(150e6)
    figures["recovery_256_mb"] = recovery(256e6)
    os.sched_setaffinity(0, cores)
    figures["loss_at_kill"] = loss("ours", kills)
    figures["loss_at_kill_mcap_json_writer"] = loss("peer", kills)
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--child", nargs=2, metavar=("KIND", "FOLDER"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        kind, folder = arguments.child
        child_peer(Path(folder)) if kind == "peer" else asyncio.run(child_ours(Path(folder)))
        return
    print(json.dumps(run(arguments.kills), indent=None if arguments.json else 1))


if __name__ == "__main__":
    main()
