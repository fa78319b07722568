"""RTDE at 500 Hz: the native client beside the ur-rtde library, in one run, against emulators in other processes.

    python bench/rtde.py [--json] [--repeats 5] [--seconds 6] [--robots 32]

Per client: packets lost of those the controller made, and CPU time per packet made, with an idle reader and
with one that stalls 30 ms every 100 ms. ``ur_rtde`` is the library's RTDEReceiveInterface read in the loop its
documentation shows (initPeriod, waitPeriod). Then many robots on one core with the native client, and how fast
packets are decoded when nothing else is done. Clients take turns; each figure is the median of the repeats with
its smallest and largest.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import struct
import subprocess
import sys
import time

import numpy as np

from cellwatt import Account
from cellwatt.emulation import RecordedSignals
from cellwatt_drivers.ur import UrDriver, wire
from cellwatt_drivers.ur.emulator import UrEmulator
from cellwatt_drivers.ur.fields import FIELDS
from cellwatt_drivers.ur.recipe import Decoder, Selection

RATE = 500.0
TARGETS = ("target_q", "target_qd", "target_qdd", "target_current", "target_moment")
ACTUALS = ("actual_q", "actual_qd", "actual_current", "joint_temperatures", "actual_joint_voltage")
BUS = ("actual_main_voltage", "actual_robot_voltage", "actual_robot_current")
FIELDS_17 = (*TARGETS, *ACTUALS, *BUS, "robot_mode", "safety_mode", "runtime_state")
"""With the timestamp 17 fields, 528 bytes a packet."""
STALL, STALL_EVERY = 0.030, 0.100
WARM = 200
"""Packets of each robot before a measurement begins."""
ADDRESS = "127.0.32.1:30004"
SERVERS = 4
"""Processes that share the emulated robots of the many-robots row."""


class Counting:
    """An inlet that only counts."""

    def __init__(self) -> None:
        self.account = Account()
        self.blocks = 0
        self.warm = asyncio.Event()

    def now(self) -> int:
        return time.time_ns()

    def emit(self, reading) -> None:
        self.account.receive(len(reading.values))
        self.blocks += 1
        if self.account.received > WARM:
            self.warm.set()

    def connected(self, identity) -> None: ...

    def bracket(self, stream, device_time, not_before) -> None: ...

    def clock_reset(self, stream, reason) -> None: ...

    def event(self, kind, text, **data) -> None: ...


async def native(addresses: list[str], seconds: float, stalled: bool) -> dict[str, float]:
    """All robots in one loop: packets made and lost, and CPU s, within the time."""
    inlets = [Counting() for _ in addresses]
    drivers = []
    for address, inlet in zip(addresses, inlets, strict=True):
        host, _, port = address.rpartition(":")
        settings = UrDriver.Settings(host=host, port=int(port), rate=RATE, channels=FIELDS_17)
        drivers.append(asyncio.create_task(UrDriver("arm", settings, inlet).run()))
    async with asyncio.timeout(60):
        for inlet in inlets:
            await inlet.warm.wait()
    made = sum(o.account.expected for o in inlets)
    lost = made - sum(o.account.received for o in inlets)
    blocks = sum(o.blocks for o in inlets)
    cpu, end = time.process_time(), time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        await asyncio.sleep(min(left, STALL_EVERY - STALL))
        if stalled:
            time.sleep(STALL)  # noqa: ASYNC251 - the stall is what is measured
    cpu = time.process_time() - cpu
    expected = sum(o.account.expected for o in inlets)
    received = sum(o.account.received for o in inlets)
    blocks = sum(o.blocks for o in inlets) - blocks
    for driver in drivers:
        driver.cancel()
    await asyncio.gather(*drivers, return_exceptions=True)
    made = expected - made
    return {"made": made, "lost": expected - received - lost, "cpu": cpu, "seconds": seconds, "blocks": blocks}


def library(address: str, seconds: float, stalled: bool) -> dict[str, float]:
    """The same with the library's newest state, told apart by its timestamp."""
    from rtde_receive import RTDEReceiveInterface

    receive = RTDEReceiveInterface(address.partition(":")[0], RATE, ["timestamp", *FIELDS_17])
    read = [getattr(receive, "get" + "".join(word.capitalize() for word in f.split("_"))) for f in FIELDS_17]
    time.sleep(0.5)
    first = last = receive.getTimestamp()
    seen = 0
    cpu, end, stall_at = time.process_time(), time.monotonic() + seconds, time.monotonic() + STALL_EVERY
    while time.monotonic() < end:
        start = receive.initPeriod()
        stamp = receive.getTimestamp()
        if stamp != last:
            last = stamp
            seen += 1
            for get in read:
                get()
        if stalled and time.monotonic() >= stall_at:
            time.sleep(STALL)
            stall_at = time.monotonic() + STALL_EVERY - STALL
        receive.waitPeriod(start)
    cpu = time.process_time() - cpu
    receive.disconnect()
    made = round((last - first) * RATE)
    return {"made": made, "lost": made - seen, "cpu": cpu, "seconds": seconds}


def decode_rate(packets: int = 200_000, chunk: int = 1 << 16) -> float:
    """Packets a second through framing and decoding, fed in chunks as a socket gives them."""
    selection = Selection.of(FIELDS_17)
    decoder = Decoder(selection, 1, [FIELDS[n].type for n in selection.names])
    body = bytes(decoder.package.size - 12)
    header = struct.pack(">HBB", decoder.package.size, ord("U"), 1)
    data = memoryview(b"".join(header + struct.pack(">d", i / RATE) + body for i in range(packets)))
    start, position, done = time.perf_counter(), 0, 0
    while position < len(data):
        for item, used in wire.scan(data[position : position + chunk], wire.FROM_CONTROLLER, decoder.package):
            decoder.decode(item.data, item.count)
            done += item.count
            end = position + used
        position = end
    assert done == packets
    return packets / (time.perf_counter() - start)


async def serve(addresses: list[str]) -> None:
    """Emulated robots in this process; prints their addresses, ends with standard input."""
    clock = np.arange(2000) / RATE
    columns = {f"joint_{i}.position": np.sin(clock + i) for i in range(1, 7)}
    signals = _Moving(RecordedSignals(clock, columns, loop=True))
    ready: list[asyncio.Future[str]] = []
    serving = []
    for address in addresses:
        ready.append(asyncio.get_running_loop().create_future())
        serving.append(asyncio.create_task(UrEmulator(signals, address).serve(ready[-1].set_result)))
    print(" ".join(await asyncio.gather(*ready)), flush=True)
    await asyncio.to_thread(sys.stdin.read)
    for task in serving:
        task.cancel()
    await asyncio.gather(*serving, return_exceptions=True)


class _Moving:
    """A recording served as a function of time, on the controller's own cycle."""

    def __init__(self, recording: RecordedSignals) -> None:
        self.at = recording.at
        self.disturb = recording.disturb


class Servers:
    """Emulated robots in processes of their own, on another core than this one's where there is one."""

    def __init__(self, groups: list[list[str]]) -> None:
        self._groups = groups

    def __enter__(self) -> list[str]:
        command = [sys.executable, __file__, "--core=-1", "--serve"]
        pipe = subprocess.PIPE
        self._children = [subprocess.Popen([*command, *g], stdin=pipe, stdout=pipe, text=True) for g in self._groups]
        return [a for child in self._children for a in child.stdout.readline().split()]

    def __exit__(self, *_: object) -> None:
        for child in self._children:
            child.communicate()


def measure(kind: str, addresses: list[str], seconds: float, stalled: bool) -> dict[str, float]:
    """One measurement in a process of its own, on the first core."""
    command = [sys.executable, __file__, "--core=0", "--measure", kind, "--seconds", str(seconds), *addresses]
    done = subprocess.run([*command, *(["--stalled"] if stalled else [])], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def spread(values: list[float]) -> dict[str, float]:
    """Median, smallest and largest."""
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def compare(kinds: list[str], repeats: int, seconds: float) -> dict[str, dict[str, float]]:
    """All clients in turns against one robot."""
    results: dict[str, list[float]] = {}
    with Servers([[ADDRESS]]) as addresses:
        for _ in range(repeats):
            for stalled in (False, True):
                for kind in kinds:
                    found = measure(kind, addresses, seconds, stalled)
                    name = f"{kind}.{'stalled' if stalled else 'idle'}"
                    results.setdefault(f"{name}.lost_percent", []).append(100 * found["lost"] / found["made"])
                    results.setdefault(f"{name}.cpu_us_per_packet", []).append(1e6 * found["cpu"] / found["made"])
    return {name: spread(values) for name, values in results.items()}


def many(robots: int, repeats: int, seconds: float) -> dict[str, dict[str, float]]:
    """Many robots on one core, native client."""
    results: dict[str, list[float]] = {}
    groups = [["127.0.0.1:0"] * len(part) for part in np.array_split(np.arange(robots), min(SERVERS, robots))]
    for _ in range(repeats):
        for stalled in (False, True):
            with Servers(groups) as addresses:
                found = measure("native", addresses, seconds, stalled)
            name = f"native.{robots}_robots.{'stalled' if stalled else 'idle'}"
            results.setdefault(f"{name}.lost", []).append(found["lost"])
            results.setdefault(f"{name}.packets_per_s", []).append(found["made"] / found["seconds"])
            results.setdefault(f"{name}.packets_per_block", []).append(found["made"] / found["blocks"])
            results.setdefault(f"{name}.cpu_percent", []).append(100 * found["cpu"] / found["seconds"])
    return {name: spread(values) for name, values in results.items()}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--robots", type=int, default=32)
    for hidden in ("--serve", "--stalled"):
        parser.add_argument(hidden, action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    parser.add_argument("--core", type=int, help=argparse.SUPPRESS)
    parser.add_argument("addresses", nargs="*", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.core is not None:
        os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[given.core]})
    if given.serve:
        asyncio.run(serve(given.addresses))
    elif given.measure == "native":
        print(json.dumps(asyncio.run(native(given.addresses, given.seconds, given.stalled))))
    elif given.measure:
        print(json.dumps(library(given.addresses[0], given.seconds, given.stalled)))
    else:
        report(given.repeats, given.seconds, given.robots, given.json)


def report(repeats: int, seconds: float, robots: int, as_json: bool) -> None:
    """Run everything and print it."""
    kinds = ["native", "ur_rtde"]
    try:
        import rtde_receive  # noqa: F401
    except ImportError:
        kinds = ["native"]
    results = compare(kinds, repeats, seconds)
    results |= many(robots, repeats, seconds)
    results["native.decode_packets_per_s"] = spread([decode_rate() for _ in range(repeats)])
    print(json.dumps({f"rtde.{name}": figures for name, figures in results.items()}, indent=None if as_json else 1))


if __name__ == "__main__":
    main()
