"""What does not reach a sample: busy neighbours, and processes of the daemon that are killed.

    python bench/isolation.py --json [--peer ../cellwatt-before] [--only polls kills demos]

``polls``: an arm at 500 Hz, a power board, and two polled arms at 50 and 40 Hz, beside busy processes at equal
priority; what was missed, in per cent of what was due. The emulated devices run at real-time priority, so that what is
missing is the daemon's. The daemon runs with the rights of who calls this (as root: real-time scheduling) and, as
``no_rights``, without those that concern scheduling and memory. ``--peer`` is the checkout of another version, measured
in turns with this one.

``kills``: ``kill -9`` at random moments beside busy processes: samples missing from the record or from a subscriber,
or told twice, and how long nothing came.

``demos``: ``cellwatt demo`` again and again, idle and busy: how many ended with 0.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import ctypes
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.batch import Batch
from cellwatt.emulation import EmulatorProcess
from cellwatt.frames import Frames
from cellwatt.record import Recording
from cellwatt.subscriber import Gap, Health, LinkSettings, Subscriber

HERE = Path(__file__).resolve().parents[1]
DEVICES = {"arm": "ur", "board": "power_board", "yaskawa": "yaskawa", "kinova": "kinova"}
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23
PR_SET_PDEATHSIG, PR_CAPBSET_DROP = 1, 24


@contextlib.contextmanager
def busy(n: int) -> Iterator[None]:
    """n processes that want all they can get."""
    command = [sys.executable, "-c", "while True: pass"]
    running = [subprocess.Popen(command, preexec_fn=_end_with_parent) for _ in range(n)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


@contextlib.asynccontextmanager
async def devices() -> AsyncIterator[str]:
    """Emulated devices at real-time priority; gives the sources of a cell."""
    async with contextlib.AsyncExitStack() as stack:
        lines = []
        for name, driver in DEVICES.items():
            listen = "pty" if driver == "power_board" else "127.0.0.1:0"
            more = ("--option", "answer_ms=2") if driver == "yaskawa" else ()
            device = await stack.enter_async_context(EmulatorProcess(driver, "--listen", listen, *more))
            device.be_punctual()
            host, _, port = device.address.rpartition(":")
            where = f"port: {device.address}" if driver == "power_board" else f"host: {host}, port: {port}"
            where += ", read: [torque]" if driver == "yaskawa" else ""
            lines.append(f"  {name}: {{driver: {driver}, {where}}}\n")
        yield "".join(lines)


def without_rights() -> None:
    """What a user is not allowed: a higher priority, real-time scheduling, locked memory."""
    libc = ctypes.CDLL(None)
    for capability in (CAP_IPC_LOCK, CAP_SYS_NICE):
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_NICE, resource.RLIMIT_MEMLOCK):
        resource.setrlimit(limit, (0, 0))


@contextlib.contextmanager
def daemon(tree: Path, folder: Path, sources: str, more: str = "", *, rights: bool = True) -> Iterator[Any]:
    """``cellwatt run`` of a checkout, with the packages installed here."""
    path = folder / "cell.yaml"
    path.write_text(f"site: bench\ncell: bench\nsources:\n{sources}{more}record: {{folder: {folder / 'record'}}}\n")
    parts = os.pathsep.join(str(tree / part) for part in ("daemon", "drivers", "plugins"))
    with (folder / "daemon.log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "cellwatt.commands", "run", str(path)],
            stderr=log,
            env={**os.environ, "PYTHONPATH": parts, "OMP_NUM_THREADS": "1"},
            start_new_session=True,
            preexec_fn=None if rights else without_rights,
        )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(60)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


async def polls(tree: Path, seconds: float, neighbours: int, *, rights: bool) -> dict[str, Any]:
    """Per cent of the samples due that each source missed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with devices() as sources:
            with daemon(tree, folder, sources, "stages: {segment: {arm: arm}}\n", rights=rights):
                await asyncio.sleep(8)  # connected, and all is loaded
                with busy(neighbours):
                    await asyncio.sleep(seconds)
                    end = time.time_ns()
        looks = [h for h in Recording.open(folder / "record").health() if end - seconds * 1e9 < h.time < end]
        first, last = looks[0].status["sources"], looks[-1].status["sources"]
    return {name: _missed(first[name], last[name]) for name in DEVICES}


def _missed(first: Mapping[str, Any], last: Mapping[str, Any]) -> dict[str, Any]:
    due = last["expected"] - first["expected"]
    reasons = {
        why: n - first[kind].get(why, 0)
        for kind in ("missed", "dropped")
        for why, n in last[kind].items()
        if n > first[kind].get(why, 0)
    }
    late = last["counters"].get("late", 0) - first["counters"].get("late", 0)
    return {"due": due, "percent": round(100 * sum(reasons.values()) / max(due, 1), 3), "why": reasons, "late": late}


async def kills(rounds: int, neighbours: int) -> dict[str, Any]:
    """Samples and frames that a subscriber lacks or got twice, and those that the record lacks."""
    found: dict[str, Any] = {}
    for part in ("tell", "align", "judge segment", "collect"):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            async with devices() as sources:
                more = f"stages: {{segment: {{arm: arm}}}}\nzenoh: {{listen: [tcp/127.0.0.1:{PORT}]}}\n"
                with daemon(HERE, folder, sources, more), busy(neighbours):
                    found[part] = await _killed(part, rounds)
            kept = Recording.open(folder / "record")
            for source in DEVICES:
                stream = kept.streams[source][0].name
                sequence = kept.batches(source, stream).sequence
                found[part][f"{source}_missing_in_record"] = int(np.sum(np.diff(sequence) - 1))
    return found


PORT = 17647


async def _killed(part: str, rounds: int) -> dict[str, Any]:
    got: defaultdict[str, list[int]] = defaultdict(list)
    came: list[float] = []
    gaps: list[int] = []
    status: dict[str, Any] = {}
    changed = asyncio.Event()

    async def listen(subscriber: Subscriber) -> None:
        async for message in subscriber:
            content = message.content
            if isinstance(content, Batch | Frames):
                got[message.topic] += range(content.sequence, content.sequence + len(content))
                if message.topic == "raw/arm/rtde":
                    came.append(time.monotonic())
            elif isinstance(content, Gap):
                gaps.append(content.count)
            elif isinstance(content, Health):
                status.update(content.status)
            changed.set()

    link = LinkSettings(mode="client", connect=(f"tcp/127.0.0.1:{PORT}",))
    async with _subscriber(link) as subscriber, asyncio.TaskGroup() as group:
        listening = group.create_task(listen(subscriber))
        while part not in status.get("processes", {}):
            await changed.wait()
            changed.clear()
        for _ in range(rounds):
            await asyncio.sleep(random.uniform(1.0, 4.0))
            pid = status["processes"][part]["pid"]
            os.kill(pid, signal.SIGKILL)
            while status["processes"][part]["pid"] == pid:
                await changed.wait()
                changed.clear()
        await asyncio.sleep(3)
        listening.cancel()
    return {
        "kills": rounds,
        "told_as_missing": sum(gaps),
        "missing_at_subscriber": sum(int(np.sum(np.maximum(np.diff(n) - 1, 0))) for n in got.values()),
        "twice_at_subscriber": sum(int(np.sum(np.diff(n) < 1)) for n in got.values()),
        "longest_silence_s": round(float(np.max(np.diff(came))), 3),
    }


@contextlib.asynccontextmanager
async def _subscriber(link: LinkSettings) -> AsyncIterator[Subscriber]:
    for _ in range(100):
        subscriber = Subscriber("bench", "bench", link, want=("raw", "frame", "health"))
        try:
            async with subscriber:
                yield subscriber
                return
        except Exception:
            await asyncio.sleep(0.2)
    raise SystemExit("the daemon's endpoint does not answer")


def demos(runs: int, neighbours: int, *more: str) -> dict[str, Any]:
    """How many runs of the demo ended with 0, and what the others say."""
    good, problems = 0, []
    with busy(neighbours):
        for _ in range(runs):
            command = [sys.executable, "-m", "cellwatt.commands", "demo", "--json", "--seconds", "30", *more]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
            good += done.returncode == 0
            problems += json.loads(done.stdout)["problems"] if done.stdout else ["no answer"]
    return {"runs": runs, "good": good, "problems": problems}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--peer", type=Path, help="checkout of another version")
    parser.add_argument("--only", nargs="+", choices=["polls", "kills", "demos"], default=["polls", "kills", "demos"])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--neighbours", type=int, default=10)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--demos", type=int, default=20)
    a = parser.parse_args()
    figures: dict[str, Any] = {}
    if "polls" in a.only:
        trees = {"now": HERE, **({"peer": a.peer.resolve()} if a.peer else {})}
        rights = {"rights": True, "no_rights": False}
        figures["polls"] = defaultdict(list)
        for _ in range(a.repeats):
            for version, tree in trees.items():
                for name, allowed in rights.items():
                    found = asyncio.run(polls(tree, a.seconds, a.neighbours, rights=allowed))
                    figures["polls"][f"{version}_{name}"].append(found)
                    print(version, name, found, file=sys.stderr, flush=True)
    if "kills" in a.only:
        figures["kills"] = asyncio.run(kills(a.kills, 4))
    if "demos" in a.only:
        figures["demo_idle"] = demos(a.demos, 0)
        figures["demo_all_idle"] = demos(a.demos, 0, "--cell", "all")
        figures["demo_busy"] = demos(a.demos // 2, 4)
        figures["demo_all_busy"] = demos(a.demos // 2, 4, "--cell", "all")
    print(json.dumps(figures) if a.json else json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
