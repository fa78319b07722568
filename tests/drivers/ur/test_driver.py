"""The driver against the emulator."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from cellwatt.align import Aligner
from cellwatt.batch import Batch
from cellwatt.channel import Quality
from cellwatt.demo.cells import free_endpoint
from cellwatt.emulation import ArmSignals, Fault, load_signals
from cellwatt.emulation.relay import clients
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, WrongDeviceError
from cellwatt.runtime.source import Source
from cellwatt_drivers.ur import UrDriver
from cellwatt_drivers.ur.emulator import UrEmulator
from tests.doing import doing
from tests.patience import PATIENCE, eventually

from ..inlet import CollectingInlet
from ..running import Run, endpoint, repeated, served
from .recordings import COLUMNS, write

CHANNELS = ("actual_q", "actual_qd", "actual_current", "actual_robot_voltage", "actual_robot_current", "robot_mode")
ROWS = 800
WARM = 120
"""Packages after which a fault is injected: the driver has learned the grid by then."""


def driver(address: str, **settings: object) -> UrDriver:
    values = endpoint(address) | {"channels": CHANNELS, "timeout": 1.0} | settings
    return UrDriver("arm", UrDriver.Settings(**values), CollectingInlet())


def watching(address: str, **settings: object) -> AbstractAsyncContextManager[Run[UrDriver]]:
    return repeated(driver(address, **settings))


@asynccontextmanager
async def emulated(recording: Path | None = None, **options: str) -> AsyncIterator[UrEmulator]:
    """An emulator, at the address where it listens, that serves a recording or the built-in arm."""
    signals = load_signals(recording) if recording else ArmSignals(seed=3)
    emulator = UrEmulator(signals, "127.0.0.1:0", options=options)
    async with served(emulator) as emulator.address:
        yield emulator


@asynccontextmanager
async def serving(path: Path, rows: int = ROWS, **options: str) -> AsyncIterator[tuple[UrEmulator, np.ndarray]]:
    """An emulator that serves a recording on the grid of 500 Hz, and its table."""
    table = write(path / "served.csv", 1000.402 + 0.002 * np.arange(rows))
    async with emulated(path / "served.csv", **options) as emulator:
        yield emulator, table


def expected_values(table: np.ndarray) -> np.ndarray:
    return table[:, [i for i, name in enumerate(COLUMNS) if name not in ("timestamp", "runtime_state")]]


def stamps(table: np.ndarray) -> np.ndarray:
    return np.rint(table[:, 0] * 1e9).astype(np.int64)


HOLD = {"at_end": "hold"}
"""The recording's last row goes on for ever, so that what was lost before is always followed by something."""


def numbers(device_time: np.ndarray) -> np.ndarray:
    """Numbers of packages by their controller time in a recording on the default grid."""
    return np.rint((device_time - 1000.402e9) / 2e6).astype(int)


def check_values(inlet: CollectingInlet, table: np.ndarray) -> None:
    """Each sample within the recording is its row, to the last bit."""
    rows = numbers(inlet.device_time)
    inside = rows < len(table)
    np.testing.assert_array_equal(inlet.values[inside], expected_values(table)[rows[inside]])
    np.testing.assert_array_equal(inlet.device_time[inside], stamps(table)[rows[inside]])


async def end_of(fault: Fault, emulator: UrEmulator, inlet: CollectingInlet) -> dict[str, int]:
    """End a fault and wait for packages made after it; the emulator's counts."""
    emulator.inject(fault)
    counts = dict(emulator.counts)
    await inlet.until(lambda o: numbers(o.device_time[-1:])[0] >= counts["made"] + 5)
    return counts


async def finish(emulator: UrEmulator, inlet: CollectingInlet, last: int) -> dict[str, int]:
    """Wait for the package with this controller time, ns; the emulator's counts."""
    await inlet.until(lambda o: bool(o.readings) and o.readings[-1].device_time[-1] >= last)
    return dict(emulator.counts)


async def test_what_arrives_is_the_file_exactly(tmp_path):
    async with serving(tmp_path) as (emulator, table), watching(emulator.address) as watched:
        counts = await finish(emulator, watched.inlet, stamps(table)[-1])
    inlet = watched.inlet
    np.testing.assert_array_equal(inlet.values, expected_values(table))
    np.testing.assert_array_equal(inlet.device_time, stamps(table))
    assert inlet.account.expected == inlet.account.received == counts["made"] == counts["sent"] == ROWS
    assert not inlet.resets and not watched.failures
    assert all(r.device_time is not None and r.quality is None and r.asked is None for r in inlet.readings)
    assert [i.firmware for i in inlet.identities] == ["PolyScope 5.12.0.0"]


async def test_losses_are_counted_one_by_one(tmp_path):
    async with serving(tmp_path, ROWS, **HOLD) as (emulator, table), watching(emulator.address) as watched:
        inlet = watched.inlet
        await inlet.until(lambda o: o.account.received > WARM)
        emulator.inject(Fault("loss", 0.3))
        await inlet.until(lambda o: o.account.received > WARM + 250)
        counts = await end_of(Fault("loss", 0.0), emulator, inlet)
        account, seen = inlet.account.snapshot(), inlet.device_time
    assert counts["loss"] > 0
    assert account["missed"] == {"gap": counts["loss"]}
    assert account["expected"] == numbers(seen)[-1] + 1
    assert account["received"] == account["expected"] - counts["loss"]
    check_values(inlet, table)
    assert not watched.failures and not inlet.resets


async def test_a_short_stall_is_reported_and_loses_nothing(tmp_path):
    async with serving(tmp_path) as (emulator, table), watching(emulator.address) as watched:
        await watched.inlet.until(lambda o: o.account.received > WARM)
        emulator.inject(Fault("stall", seconds=0.6))
        counts = await finish(emulator, watched.inlet, stamps(table)[-1])
    assert counts["stall"] == 1
    assert watched.inlet.kinds()[-2:] == ["stream stopped", "stream resumed"]
    assert watched.inlet.events[-1][2]["seconds"] == pytest.approx(0.6, abs=0.4)
    assert watched.inlet.account.expected == watched.inlet.account.received == ROWS
    assert not watched.failures and not watched.inlet.resets


async def test_a_disconnection_is_an_outage(tmp_path):
    async with serving(tmp_path) as (emulator, table), watching(emulator.address) as watched:
        await watched.inlet.until(lambda o: o.account.received > WARM)
        emulator.inject(Fault("disconnect", seconds=0.4))
        counts = await finish(emulator, watched.inlet, stamps(table)[-1])
    assert counts["disconnect"] == 1
    assert isinstance(watched.failures[0], ConnectError)
    assert len(watched.inlet.identities) == 2
    assert watched.inlet.account.expected == counts["made"] == ROWS
    assert watched.inlet.account.received == counts["sent"]
    assert watched.inlet.account.missed == {"outage": counts["made"] - counts["sent"]}


@pytest.mark.parametrize(
    ("kind", "counter", "error"),
    [("half_frame", "half frame", ConnectError), ("garbage", "protocol error", ProtocolError)],
)
async def test_broken_bytes_end_the_connection_and_are_counted(tmp_path, kind, counter, error):
    async with serving(tmp_path, ROWS, **HOLD) as (emulator, table), watching(emulator.address) as watched:
        inlet = watched.inlet
        await inlet.until(lambda o: o.account.received > WARM)
        emulator.inject(Fault(kind, 0.02))
        await inlet.until(lambda o: o.account.counters[counter] >= 3)
        counts = await end_of(Fault(kind, 0.0), emulator, inlet)
        account, seen = inlet.account.snapshot(), inlet.device_time
    assert account["counters"][counter] == counts[kind] >= 3
    assert sum(isinstance(e, error) for e in watched.failures) == counts[kind]
    assert account["expected"] == numbers(seen)[-1] + 1
    assert account["missed"] == {"outage": account["expected"] - account["received"]}
    check_values(inlet, table)
    assert not inlet.resets


async def test_messages_and_states_are_events(tmp_path):
    channels = ("actual_q", "runtime_state")
    async with serving(tmp_path) as (emulator, table), watching(emulator.address, channels=channels) as watched:
        await watched.inlet.until(lambda o: o.account.received > WARM)
        emulator.disturb({"message": "joint 3 is hot"})
        await finish(emulator, watched.inlet, stamps(table)[-1])
    said = {kind: text for kind, text, _ in watched.inlet.events}
    assert said["message"] == "controller warning from emulator: joint 3 is hot"
    assert said["program"] == "program: playing → paused"
    assert watched.inlet.account.expected == ROWS


async def test_fields_that_the_controller_lacks_are_named():
    async with emulated(polyscope="5.8.0") as emulator:
        arm = driver(emulator.address, channels=("actual_q", "joint_1.torque", "ft_raw_wrench"))
        with pytest.raises(DeviceError) as caught:
            await arm.run()
    assert "PolyScope 5.8.0.0 does not have actual_current_as_torque (needs 5.23.0 or 10.11.0), ft_raw_wrench" in str(
        caught.value
    )
    assert not arm.inlet.identities


async def test_a_cb3_at_the_default_rate_is_in_the_frames_and_not_too_slow():
    batches: list[Batch] = []
    async with emulated(polyscope="3.15.0") as emulator:
        arm = UrDriver.Settings(**endpoint(emulator.address))
        source = Source("arm", UrDriver, arm, time.time_ns, batches.append, lambda e: None)
        async with doing(source.run()):
            await eventually(lambda: sum(map(len, batches)) >= 150)
    aligner = Aligner({"arm": source.driver.streams}, 50.0, 0.1)
    quality = np.concatenate([f.quality for b in batches for f in aligner.add(b)])
    assert (quality[len(quality) // 2 :] == Quality.GOOD).mean() > 0.5
    assert source.status()["streams"]["rtde"]["nominal_hz"] == 125


@pytest.mark.parametrize(
    ("banner", "answer", "error", "match"),
    [
        (b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", WrongDeviceError, "does not speak RTDE"),
        (b"SSH-2.0-OpenSSH_9.6\r\n", b"", WrongDeviceError, "does not speak RTDE"),
        (b"", b"\x00\x04V\x00", DeviceError, "update PolyScope"),
        (b"", b"", ConnectError, "does not answer within"),
        (b"", None, ConnectError, r"closed|broke"),
    ],
)
async def test_somebody_else_on_the_port_is_named(banner, answer, error, match):
    """Something else that listens: it says a banner, answers each chunk, or closes."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(banner)
        while answer is not None and await reader.read(1000):
            writer.write(answer)

    async with clients(serve) as (address, _), asyncio.timeout(PATIENCE):
        with pytest.raises(error, match=match):
            await driver(address, timeout=0.2 if answer == b"" else 1.0).run()


async def test_a_robot_that_is_off_is_a_connection_error():
    with pytest.raises(ConnectError, match="is the robot on"):
        await driver(free_endpoint()).run()
