"""The emulator, without our driver: clients that we did not write."""

from __future__ import annotations

import asyncio
import itertools

import can
import cantools

from cellwatt_drivers.can_sensor.sensor_map import load_decodings
from tests.patience import wait_until

from .rig import emulated


def listen(channel: str, count: int) -> list[can.Message]:
    with can.Bus(interface="slcan", channel=channel, ignore_config=True, sleep_after_open=0) as bus:
        found = []

        def enough() -> bool:
            frame = bus.recv(0.2)
            if frame is not None and not frame.is_error_frame:
                found.append(frame)
            return len(found) >= count

        wait_until(enough, f"{count} frames")
        return found


async def test_python_can_hears_it_and_cantools_reads_it():
    async with emulated() as (_, place):
        frames = await asyncio.to_thread(listen, place, 40)
    made, _ = load_decodings("ivt_s", None)
    database = cantools.database.load_file(made.dbc)
    currents = [database.decode_message(f.arbitration_id, f.data) for f in frames if f.arbitration_id == 0x521]
    assert {round(c["I"], 3) for c in currents} == {-2.5}
    numbers = [c["I_Counter"] for c in currents]
    assert all((b - a) % 16 == 1 for a, b in itertools.pairwise(numbers))
    voltages = [f for f in frames if f.arbitration_id == 0x522]
    # 48 000 mV, high byte first; byte 0 says which result, byte 1 counts.
    assert {bytes(f.data[2:]).hex() for f in voltages} == {"0000bb80"}
    assert {f.data[0] for f in voltages} == {1}
    assert {f.dlc for f in frames} == {6}
