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
from cellwatt.slots import Slots
from cellwatt.ticker import Ticker

async def main(how):
    slots, missed, held = Slots(50.0), Counter(), False
    slots.connected()
    async with Ticker(50.0) as ticker:
        async for beat in ticker:
            for n, reason in slots.begin(beat):
                missed[reason] += n
            if sum(missed.values()) > 8:
                break
            if how == "slow answers" and not held:
                held = True
                await asyncio.sleep(0.4)
            slots.end()
            if how == "merged tick" and not held:
                held = True
                end = time.thread_time() + 0.4
                while time.thread_time() < end:
                    pass
            if how == "host stalled" and not held:
                held = True
                print("stop me", flush=True)
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
    # The machine that runs the tests may take its share of the slots, but most are of what was done here.
    assert max(missed, key=lambda reason: missed[reason]) == how


def test_slots_without_a_connection_are_told_apart() -> None:
    slots = Slots(50.0)
    slots.connected()
    assert slots.begin(Beat(1000 * MS, 0)) == [], "nothing was due before the first connection"
    slots.end()
    slots.connected()
    assert slots.begin(Beat(2000 * MS, 0)) == [(49, "disconnected")]
    slots.end()
    assert slots.begin(Beat(2020 * MS, 0)) == []


def test_an_answer_that_nothing_else_held_up_was_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.slots._ready_ns", lambda: 0)
    slots = Slots(50.0)
    slots.begin(Beat(1000 * MS, 0))
    slots.end()
    slots._idle = 1070 * MS  # an answer that took 70 ms
    assert slots.begin(Beat(1080 * MS, 3)) == [(2, "slow answers"), (1, "host stalled")]
