"""An emulated IVT-S at 1 kHz on two results over udp_multicast, beside python-can's Notifier with cantools.

    python bench/drivers/can_sensor.py

The sensor runs in a process of its own. Both sides receive and decode every frame; the plain loop takes them from
``can.AsyncBufferedReader``, decodes with cantools and does nothing else.
"""

from __future__ import annotations

import asyncio
from functools import partial

import can
import cantools
from sides import Length, Result, Run, Still, accounts, driven, ended, in_turns, main, measured, served

from cellwatt_drivers.can_sensor import CanSensorDriver, CanSensorSettings
from cellwatt_drivers.can_sensor.emulator import MULTICAST_GROUP, CanSensorEmulator
from cellwatt_drivers.can_sensor.sensor_map import load_decodings

RATE = 1000.0
STREAMS = ("current", "voltage_1")
PORT = 43977


def devices() -> list[CanSensorEmulator]:
    cycles = ",".join(f"{name}={1e3 / RATE:g}" for name in STREAMS)
    return [CanSensorEmulator(Still(), f"udp_multicast:{MULTICAST_GROUP}:{PORT}", options={"cycles": cycles})]


async def ours(seconds: float) -> Run:
    settings = CanSensorSettings(
        sensor="ivt_s",
        interface="udp_multicast",
        channel=MULTICAST_GROUP,
        port=PORT,
        read=STREAMS,
        rates=dict.fromkeys(STREAMS, RATE),
    )
    async with driven([partial(CanSensorDriver, "battery", settings)]) as inlets:
        return await measured(accounts(inlets), seconds)


async def plain(seconds: float) -> Run:
    made, _ = load_decodings("ivt_s", None)
    messages = {m.frame_id: m for m in cantools.database.load_file(made.dbc).messages}
    counters = {m.frame_id: next(s.name for s in m.signals if s.name.endswith("_Counter")) for m in messages.values()}
    counts, last = [0, 0], {}
    reader = can.AsyncBufferedReader()

    async def read() -> None:
        while True:
            frame = await reader.get_message()
            signals = messages[frame.arbitration_id].decode(frame.data, decode_choices=False)
            number = signals[counters[frame.arbitration_id]]
            counts[0] += 1
            counts[1] += (number - last.get(frame.arbitration_id, number - 1)) % 16 - 1
            last[frame.arbitration_id] = number

    bus = can.Bus(interface="udp_multicast", channel=MULTICAST_GROUP, port=PORT, hop_limit=0, ignore_config=True)
    notifier = can.Notifier(bus, [reader], loop=asyncio.get_running_loop())
    task = asyncio.create_task(read())
    run = await measured(lambda: (counts[0], counts[1]), seconds)
    await ended([task])
    await asyncio.to_thread(notifier.stop)
    bus.shutdown()
    return run


async def bench(length: Length) -> Result:
    """Both sides in turns on the same bus; a device is a result of the sensor."""
    async with served(__file__):
        both = await in_turns(ours, plain, length)
    return Result(len(STREAMS), RATE, length.seconds, length.repeats, "python-can + cantools", *both)


if __name__ == "__main__":
    main(bench, devices)
