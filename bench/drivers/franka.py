"""An emulated Franka robot at 1 kHz, read by the driver, beside pylibfranka's ``read_once`` in a loop.

    python bench/drivers/franka.py

The robot runs in a process of its own, and so does the library on both sides; the driver's share of a core is that of
its process and of the daemon's together. How late a state is counts from the state that came quickest.
"""

from __future__ import annotations

import asyncio
import json
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import psutil
from sides import Length, Result, Run, Still, accounts, driven, in_turns, main, measured, served

from cellwatt_drivers.franka import FrankaDriver, receive
from cellwatt_drivers.franka.driver import FrankaSettings
from cellwatt_drivers.franka.emulator import FrankaEmulator

ADDRESS, RATE = "127.0.43.1", 1000.0
PLAIN = """
import json, sys, time, pylibfranka
robot = pylibfranka.Robot(sys.argv[1], pylibfranka.RealtimeConfig.kIgnore)
end = time.monotonic() + 1.0
while time.monotonic() < end:
    robot.read_once()
stamps, late, cpu, begin = [], [], time.process_time(), time.monotonic()
while time.monotonic() < begin + float(sys.argv[2]):
    state = robot.read_once()
    values = state.q, state.dq, state.tau_J, state.theta, state.dtheta, state.tau_ext_hat_filtered, state.robot_mode
    stamps.append(state.time.to_sec())
    late.append(time.time() - stamps[-1])
share = (time.process_time() - cpu) / (time.monotonic() - begin)
print(json.dumps([[round(s * 1e3) for s in stamps], late, share]))
"""


def devices() -> list[FrankaEmulator]:
    return [FrankaEmulator(Still(), f"{ADDRESS}:1337", options={"realtime": "1"})]


async def ours(seconds: float) -> Run:
    async with driven([partial(FrankaDriver, "arm", FrankaSettings(host=ADDRESS))]) as inlets:
        us = [psutil.Process(), *(c for c in psutil.Process().children() if receive.__name__ in c.cmdline())]
        run = await measured(accounts(inlets), seconds, lambda: sum(sum(p.cpu_times()[:2]) for p in us))
        return replace(run, late=np.concatenate(inlets[0].late)[-run.samples :])


async def plain(seconds: float) -> Run:
    child = await asyncio.create_subprocess_exec(
        sys.executable, "-c", PLAIN, ADDRESS, str(seconds), stdout=asyncio.subprocess.PIPE
    )
    out, _ = await child.communicate()
    stamps, late, share = json.loads(out)
    return Run(len(stamps), stamps[-1] - stamps[0] + 1 - len(stamps), share, np.array(late))


async def bench(length: Length) -> Result:
    """Both sides in turns, at the same robot."""
    async with served(__file__):
        both = await in_turns(ours, plain, length)
    return Result(1, RATE, length.seconds, length.repeats, "pylibfranka", *both)


if __name__ == "__main__":
    main(bench, devices)
