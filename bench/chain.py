"""The whole chain, sources to Zenoh, recorded: throughput, and latency of raw samples, frames and alarms.

    python bench/chain.py --json
    python bench/chain.py --json --robots 32 --stages

Emulated UR controllers (500 Hz, the full default recipe plus more: 62 values) run in one process, the daemon in
others, a plain Zenoh subscriber in a last. Latency is told from the subscriber's receipt:
``daemon`` since the newest packet of a message came to this PC, ``emulator`` since the emulator sent each packet of it
(the fastest of a run counts as 0, so constant transport time is not in it). ``frame_ms`` and ``alarm_ms`` are since
the time that a frame is for, and that of the frame that raised or cleared an alarm; frames wait 100 ms for samples.
The first robot jumps out of the range of a model of its power every other second, which is an alarm.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from footprint import computed, family, free_port, memory
from numpy.typing import NDArray

from cellwatt.demo.cells import MODEL

CHANNELS = (
    "actual_q", "actual_qd", "actual_current", "target_q", "target_qd", "target_moment", "target_current",
    "joint_temperatures", "actual_joint_voltage", "actual_robot_voltage", "actual_robot_current",
    "actual_main_voltage", "speed_scaling", "robot_mode", "safety_mode", "runtime_state", "bus.power",
)  # fmt: skip
VALUES = 62
RATE = 500.0
WARM_UP = 3.0  # s


class Still:
    """Signals that cost the emulators next to nothing; ``jumps``: joint 1 is elsewhere in every other second."""

    def __init__(self, jumps: bool) -> None:
        self._jump = 6.0 * jumps

    def at(self, t: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
        still = {f"joint_{i}.position": np.full(len(t), 0.1 * i) for i in range(2, 7)}
        return still | {"joint_1.position": 0.1 + self._jump * (t % 2 < 1)}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        raise ValueError("nothing to disturb")


async def devices(count: int) -> None:
    """The emulators' process: tells its ports as JSON, ends with its standard input."""
    from cellwatt_drivers.ur.emulator import UrEmulator

    loop = asyncio.get_running_loop()
    ports: list[asyncio.Future[str]] = [loop.create_future() for _ in range(count)]
    tasks = [
        asyncio.create_task(UrEmulator(Still(n == 0), "127.0.0.1:0", seed=n).serve(ready.set_result))
        for n, ready in enumerate(ports)
    ]
    print(json.dumps([int((await ready).rpartition(":")[2]) for ready in ports]), flush=True)
    await loop.run_in_executor(None, sys.stdin.read)
    for task in tasks:
        task.cancel()


def listen(endpoint: str) -> None:
    """The subscriber's process: receipts until its standard input ends, then percentiles as JSON."""
    import zenoh

    from cellwatt.frames import Frames
    from cellwatt.outlets.zenoh.encode import decode, schema_in
    from cellwatt.outlets.zenoh.mark import Mark

    got: list[tuple[int, str, bytes, bytes]] = []

    def receive(sample: zenoh.Sample) -> None:
        at, attachment = time.time_ns(), sample.attachment
        topic = str(sample.key_expr).removeprefix("cellwatt/bench/bench/").partition("/")[0]
        got.append((at, topic, sample.payload.to_bytes(), attachment.to_bytes() if attachment else b""))

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "20000")
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    for topic in ("raw", "frame", "alarm"):
        session.declare_subscriber(f"cellwatt/bench/bench/{topic}/**", receive)
    print("listening", flush=True)
    sys.stdin.readline()
    early, got = got, []
    start = time.monotonic()
    sys.stdin.readline()
    kept, seconds = got, time.monotonic() - start
    session.close()
    in_daemon, frames, alarms, by_robot, samples = [], [], [], {}, 0
    schemas: dict[int, bytes] = {}
    for n, (at, topic, payload, attachment) in enumerate([*early, *kept]):
        if topic == "alarm":
            alarms += [at - json.loads(payload)["time"]] * (n >= len(early))
            continue
        mark = Mark.decode(attachment, payload)
        if not mark.schema:
            schemas[zlib.crc32(schema_in(payload))] = schema_in(payload)
        if n < len(early):
            continue
        batch = decode(schemas[mark.schema] + payload if mark.schema else payload, mark)
        if isinstance(batch, Frames):
            frames += (at - batch.time).tolist()
            continue
        samples += len(batch)
        in_daemon.append(at - batch.arrival)
        by_robot.setdefault(batch.source, []).extend((at - batch.device_time).tolist())
    whole = np.concatenate([np.array(x) - min(x) for x in by_robot.values()]) * 1e-6
    print(
        json.dumps(
            {
                "samples_per_s": samples / seconds,
                "samples_per_message": samples / len(in_daemon),
                "daemon_ms": percentiles(np.array(in_daemon) * 1e-6),
                "emulator_ms": percentiles(whole),
                "frame_ms": percentiles(np.array(frames) * 1e-6),
                "alarm_ms": percentiles(np.array(alarms) * 1e-6) | {"alarms": len(alarms)},
            }
        ),
        flush=True,
    )


def percentiles(values: NDArray[np.float64]) -> dict[str, float]:
    return {f"p{p:g}": round(float(np.percentile(values, p)), 3) for p in (50, 99, 99.9)} | {
        "max": round(float(values.max()), 3)
    }


def run(robots: int, seconds: float, stages: bool, latency: str) -> dict[str, Any]:
    """One run of the daemon; its CPU share, losses and the subscriber's figures."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        emulators = spawn("devices", str(robots), cpus={1})
        ports = json.loads(line(emulators))
        write(folder / "cell.yaml", ports, endpoint, folder, stages, latency)
        daemon = subprocess.Popen(
            [sys.executable, "-m", "cellwatt.commands", "run", str(folder / "cell.yaml")],
            stderr=(folder / "log").open("w"),
        )
        subscriber = spawn("listen", endpoint, cpus={1})
        try:
            line(subscriber)
            time.sleep(WARM_UP)
            parts = family(daemon.pid)
            before, start = computed(parts), time.monotonic()
            tell(subscriber)
            time.sleep(seconds)
            tell(subscriber)
            cpu = (computed(parts) - before) / (time.monotonic() - start)
            weight = memory(parts)
            figures = json.loads(line(subscriber))
            daemon.send_signal(signal.SIGTERM)
            daemon.wait(30)
            status = last_health(folder)
        finally:
            for child in (daemon, subscriber, emulators):
                child.kill()
                child.wait()
    sources = status["sources"].values()
    lost = sum(sum(s["missed"].values()) + sum(s["dropped"].values()) for s in sources)
    unpublished = sum(status["sinks"]["zenoh"]["dropped"].values())
    return figures | {
        "robots": robots,
        "values_per_s": round(figures["samples_per_s"] * VALUES),
        "cpu_of_one_core": round(cpu, 3),
        "lost": lost,
        "not_published": unpublished,
        "not_recorded": sum(status["recorder"]["drops"].values()),
        "frames_judged": min(s["frames"] for s in status["stages"].values()),
        "frames_not_judged": sum(s["dropped"] for s in status["stages"].values()),
        "pss_mb": weight,
    }


def last_health(folder: Path) -> dict[str, Any]:
    from cellwatt.record import Recording

    return dict(list(Recording.open(folder / "record").health())[-1].status)


def write(path: Path, ports: Sequence[int], endpoint: str, folder: Path, stages: bool, latency: str) -> None:
    channels = "[" + ", ".join(CHANNELS) + "]"
    sources = "\n".join(
        f"  robot_{i}: {{driver: ur, host: 127.0.0.1, port: {port}, channels: {channels}}}"
        for i, port in enumerate(ports)
    )
    named = "".join(f"  tasks_{i}: {{stage: segment, arm: robot_{i}}}\n" for i in range(len(ports)))
    model = f"  power: {{stage: model, file: {MODEL}, source: robot_0}}\n"
    judged = f"robot: demo\nstages:\n{model}{named if stages else ''}"
    path.write_text(
        f"site: bench\ncell: bench\nlatency: {latency}\nsources:\n{sources}\n{judged}"
        f"record: {{folder: {folder / 'record'}}}\n"
        f"zenoh: {{listen: [{endpoint}]}}\n"
    )


def spawn(role: str, argument: str, cpus: set[int]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, __file__, "--role", role, argument],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: os.sched_setaffinity(0, cpus),
    )


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def tell(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--robots", type=int, nargs="*", default=[8, 16, 32])
    parser.add_argument("--stages", action="store_true", help="cut the motion of every robot into tasks, too")
    parser.add_argument("--latency", choices=["normal", "low"], default="normal")
    parser.add_argument("--role", nargs=2, metavar=("ROLE", "ARGUMENT"))
    a = parser.parse_args()
    if a.role:
        role, argument = a.role
        asyncio.run(devices(int(argument))) if role == "devices" else listen(argument)
        return
    runs = [run(robots, a.seconds, a.stages, a.latency) for robots in a.robots for _ in range(a.repeats)]
    print(json.dumps(runs, indent=None if a.json else 1))


if __name__ == "__main__":
    main()
