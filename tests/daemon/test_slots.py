"""Slots that nobody served are told by what held them up: measured on a process that is held up in each way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from cellwatt.slots import Slots
from cellwatt.ticker import Beat
from tests.patience import PATIENCE

MS = 1_000_000
PROGRAM = """
import asyncio, json, sys, time
from collections import Counter
from cellwatt.processor import RunDelay
from cellwatt.slots import Slots

async def main(how):
    missed, held = Counter(), False

    def compute():
        end = time.thread_time() + 0.4
        kept = RunDelay()
        while time.thread_time() < end:
            pass
        missed["kept from it"] = kept.look() > 2e8

    async with Slots(50.0, lambda n, reason: missed.update({reason: n})) as slots:
        async for beat in slots:
            if sum(missed.values()) > 9:
                break
            if held:
                continue
            held = True
            if how == "slow answers":
                await asyncio.sleep(0.4)
            elif how == "merged tick":
                asyncio.get_running_loop().call_soon(compute)
            else:
                asyncio.get_running_loop().call_soon(lambda: print("stop me", flush=True))  # once the slot has ended
    print(json.dumps(missed))

asyncio.run(main(sys.argv[1]))
"""


@pytest.mark.parametrize("how", ["slow answers", "merged tick", "host stalled"])
def test_what_held_a_slot_up_is_measured(how: str) -> None:
    with subprocess.Popen([sys.executable, "-c", PROGRAM, how], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        if how == "host stalled":
            assert process.stdout.readline() == "stop me\n"
            os.kill(process.pid, signal.SIGSTOP)
            time.sleep(0.5)  # what is tested: the process stands still for so long
            os.kill(process.pid, signal.SIGCONT)
        missed = json.loads(process.communicate(timeout=PATIENCE)[0])
    if missed.pop("kept from it", False):
        pytest.skip("the machine was too busy to let a process compute")
    # The machine that runs the tests may take its share of the slots, but most are of what was done here.
    assert max(missed, key=lambda reason: missed[reason]) == how


def untold(slots: int, reason: str) -> None:
    raise AssertionError("only the slots of a ticker are reported")


def test_slots_without_a_connection_are_told_apart() -> None:
    slots = Slots(50.0, untold)
    slots.connected()
    assert slots.begin(Beat(1000 * MS, 0)) == [], "nothing was due before the first connection"
    slots.end()
    slots.connected()
    assert slots.begin(Beat(2000 * MS, 0)) == [(49, "disconnected")]
    slots.end()
    assert slots.begin(Beat(2020 * MS, 0)) == []
    slots.end()
    assert slots.begin(Beat(2060 * MS, 1)) == [], "what was missed since is no matter of the connection"


@pytest.mark.parametrize(
    ("stolen", "reason"), [((0, 40), "host stalled"), ((10, 10), "slow answers"), ((), "slow answers")]
)
def test_an_answer_that_waited_for_a_core_kept_by_the_hypervisor_was_not_slow(
    monkeypatch: pytest.MonkeyPatch, stolen: tuple[int, ...], reason: str
) -> None:
    at = {"now": tuple(5000 * MS for _ in stolen)}
    monkeypatch.setattr("cellwatt.processor._ready_ns", lambda: 0)
    monkeypatch.setattr("cellwatt.processor._steal.now", lambda: at["now"])
    slots = Slots(50.0, untold)
    slots.begin(Beat(1000 * MS, 0))
    at["now"] = tuple(5000 * MS + MS * core for core in stolen)
    slots.end()
    slots._idle = 1070 * MS  # an answer that took 70 ms: two slots went by
    told = slots.begin(Beat(1060 * MS, 2))
    slots.end()
    told += slots.begin(Beat(1080 * MS, 0))
    assert told == [(2, reason)]


@pytest.mark.parametrize(
    ("ready", "computed", "reason"), [(0, 20, "merged tick"), (25, 20, "host stalled"), (0, 12, "host stalled")]
)
def test_a_late_turn_is_ours_where_computing_took_longer_than_waiting_for_a_core(
    monkeypatch: pytest.MonkeyPatch, ready: int, computed: int, reason: str
) -> None:
    at = {"ready": 0, "computed": 0}
    monkeypatch.setattr("cellwatt.processor._ready_ns", lambda: at["ready"])
    monkeypatch.setattr("cellwatt.processor._steal.now", lambda: ())
    monkeypatch.setattr("cellwatt.slots.time.thread_time_ns", lambda: at["computed"])
    slots = Slots(50.0, untold)
    slots.begin(Beat(1000 * MS, 0))
    slots.end()
    slots._idle = 1005 * MS
    at.update(ready=ready * MS, computed=computed * MS)
    assert slots.begin(Beat(1040 * MS, 1)) == [(1, reason)]
