"""What the driver says of ports and boards that are not what was configured; fed by hand through a pty."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
import pytest
import serial

from cellwatt import ConnectError, ProtocolError, SourceError, WrongDeviceError
from cellwatt_drivers.power_board import PowerBoardDriver, PowerBoardSettings, wire
from cellwatt_drivers.power_board import port as port_module
from cellwatt_drivers.power_board.payload import build
from cellwatt_drivers.power_board.virtual_port import VirtualPort
from cellwatt_drivers.shared import serial_port
from tests.doing import doing
from tests.drivers.power_board.rig import Inlet
from tests.drivers.power_board.samples import NETWORK, SENDER, packet
from tests.patience import PATIENCE, eventually


def frame(number: int, **fields) -> bytes:
    return wire.wrap(build(packet(number, **fields)), "api", sender=SENDER, network=NETWORK)


@pytest.fixture
def line():
    port = VirtualPort()
    yield port
    port.unplug()


def driver(port: str, **settings) -> PowerBoardDriver:
    return PowerBoardDriver("board", PowerBoardSettings(port=port, **settings), Inlet())


async def failure(running_driver: PowerBoardDriver, kind: type[SourceError] = ConnectError) -> SourceError:
    with pytest.raises(kind) as caught:
        await asyncio.wait_for(running_driver.run(), PATIENCE)
    return caught.value


@asynccontextmanager
async def listening(line: VirtualPort, **settings):
    """A driver that has the port open, and its inlet."""
    made = driver(line.path, silence="20 s", **settings)
    async with doing(made.run()):
        await eventually(lambda: line.opened and not line.read() and line.flushed)
        yield made, made.inlet


async def test_missing_port_names_those_that_are_there(tmp_path: Path, monkeypatch) -> None:
    gone = str(tmp_path / "ttyUSB9")
    monkeypatch.setattr(serial_port, "BY_ID", tmp_path / "by-id")
    assert str(await failure(driver(gone))) == f"{gone}: no such port (no USB serial adapter is plugged in)"
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-FTDI_A1-if00").touch()
    assert str(await failure(driver(gone))) == f"{gone}: no such port (in {tmp_path / 'by-id'}: usb-FTDI_A1-if00)"


async def test_a_port_without_a_board_says_why(line: VirtualPort, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    assert "is not a serial port" in str(await failure(driver(str(tmp_path / "file"))))
    with serial.Serial(line.path, exclusive=True):
        program = psutil.Process().name()
        assert str(await failure(driver(line.path))) == f"{line.path}: in use by {program} (process {os.getpid()})"
        monkeypatch.setattr(serial_port, "iglob", lambda _: ["/proc/0/fd/0"])  # of other users nothing is shown
        assert str(await failure(driver(line.path))) == f"{line.path}: in use by another program"
    silent = f"{line.path}: in 0.05 s not one byte at 115200 baud"
    assert silent in str(await failure(driver(line.path, silence="50 ms")))


async def feed(line: VirtualPort, until: Callable[[], bool], data: Callable[[int], bytes], first: int = 1) -> int:
    """Write the data of each number to the open port until a condition holds; return the next number."""
    async with asyncio.timeout(PATIENCE):
        while not until():
            if line.opened:
                line.write(data(first))
                first += 1
            await asyncio.sleep(0.01)
    return first


async def feed_until_failure(line: VirtualPort, data: bytes, kind: type[SourceError], **settings) -> SourceError:
    failing = asyncio.create_task(failure(driver(line.path, silence="300 ms", **settings), kind))
    await feed(line, failing.done, lambda _: data)
    return await failing


async def test_wrong_baud_rate(line: VirtualPort) -> None:
    error, again = [await feed_until_failure(line, bytes(range(n)), ProtocolError, baud=57600) for n in (256, 99)]
    assert "bytes but no valid frame at 57600 baud: wrong baud rate or mode?" in str(error)
    assert str(again) == str(error), "else each attempt is an event of its own"


@pytest.mark.parametrize(
    ("data", "settings", "why"),
    [
        (frame(1, board=9) + frame(1, board=8), {"boards": [7]}, "only board 8, 9 is received, but not the wanted"),
        (frame(1, phases=1), {}, "board 7 measures 1 phases, but phases: 3 is configured"),
    ],
)
async def test_another_board_is_the_wrong_device(line: VirtualPort, data, settings, why) -> None:
    assert why in str(await feed_until_failure(line, data, WrongDeviceError, **settings))


async def test_first_board_heard_is_the_one(line: VirtualPort) -> None:
    async with listening(line) as (_, inlet):
        line.write(frame(1, board=3) + frame(5, board=4) + frame(2, board=3))
        await eventually(lambda: inlet.account.received == 2)
        assert inlet.account.counters["other boards"] == 1
        assert inlet.identities[0].model == "power board 3"


async def test_several_boards_share_a_port(line: VirtualPort) -> None:
    async with listening(line, boards=[3, 4]) as (made, inlet):
        assert [s.name for s in made.streams] == ["power_3", "power_4"]
        assert made.streams[1].names[:2] == ("board_4.supply.voltage", "board_4.supply.current")
        line.write(
            frame(10, board=3) + frame(77, board=4) + frame(11, board=3) + frame(80, board=4) + frame(81, board=4)
        )
        await eventually(lambda: inlet.account.received == 5)
        assert inlet.account.missed == {"gap": 2}
        assert {r.stream.name: len(r.values) for r in inlet.readings[:1]} == {"power_3": 2}


async def test_one_of_several_boards_falls_silent(line: VirtualPort) -> None:
    made = driver(line.path, boards=[3, 4], silence="300 ms")
    async with doing(made.run()):
        number = await feed(line, lambda: len(made.inlet.texts()) >= 1, lambda n: frame(n, board=3))
        await feed(line, lambda: len(made.inlet.texts()) >= 2, lambda n: frame(n, board=3) + frame(n, board=4), number)
    assert made.inlet.texts() == ["board: board 4: silent", "board: board 4: heard again"]


async def test_restarted_board_is_reported_and_goes_on(line: VirtualPort) -> None:
    async with listening(line) as (_, inlet):
        line.write(frame(50_000) + frame(50_001) + frame(0) + frame(1) + frame(3))
        await eventually(lambda: inlet.account.received == 5)
        assert inlet.resets == ["it restarted"]
        assert inlet.account.missed == {"gap": 1}
        assert inlet.device_time.tolist()[2:] == [0, 8_130_000, 24_390_000]


async def test_what_waits_is_given_when_the_port_goes(line: VirtualPort) -> None:
    made = driver(line.path, reorder="10 s", silence="20 s")
    task = asyncio.create_task(made.run())
    await feed(line, lambda: made.inlet.account.received > 0, lambda _: frame(0))
    line.write(frame(2) + b"\x00")
    await eventually(lambda: made.inlet.account.counters["garbage bytes"] == 1)
    line.unplug()
    with pytest.raises(ConnectError, match="the port is gone"):
        await asyncio.wait_for(task, PATIENCE)
    assert made.inlet.account.received == 2
    assert made.inlet.account.missed == {"gap": 1}


async def test_latency_timer_is_noted(line: VirtualPort, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(port_module, "ADAPTERS", tmp_path)
    timer = tmp_path / Path(line.path).name / "latency_timer"
    timer.parent.mkdir()
    for text, noted in (("16\n", True), ("1\n", False), ("soon", False)):
        timer.write_text(text)
        identifying = asyncio.create_task(driver(line.path).identify())
        await feed(line, identifying.done, lambda _: frame(1))
        assert ("latency timer" in (await identifying).notes) == noted
