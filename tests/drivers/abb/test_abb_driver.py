from __future__ import annotations

import asyncio
import socket
import time

import numpy as np
import pytest

from cellwatt.account import Account
from cellwatt.emulation import Fault
from cellwatt.emulation.relay import clients
from cellwatt.errors import ConnectError, DeviceError, WrongDeviceError
from cellwatt.results import Event
from cellwatt.runtime.source import Source
from cellwatt.slots import HOST
from cellwatt_drivers.abb import AbbDriver, AbbSettings
from cellwatt_drivers.abb.egm import listening
from cellwatt_drivers.abb.rws import MODE
from cellwatt_drivers.abb.web import session
from tests.doing import doing
from tests.patience import PATIENCE, eventually

from ..certificates import self_signed
from ..running import once
from .rig import ANGLES, driver, emulated, free_port, running


def assert_only_late(inlet):
    """Nothing of the stream is lost; pages that fell due while a busy machine still read the last ones are told."""
    account = inlet.account
    assert set(+account.missed) <= {"slow answers", HOST}, account.missed
    assert account.expected == account.received + account.missed.total()


@pytest.mark.parametrize("robotware", [6, 7])
async def test_motion_states_and_energy(robotware):
    groups = ("joints", "planned", "state", "force")
    async with emulated(robotware=str(robotware)) as (emulator, place):
        async with running(place, robotware=robotware, egm=groups, web_rate="10 Hz") as (inlet, _):
            await inlet.until(lambda o: len(o.of("egm")) > 100 and len(o.of("energy")) > 1)
        assert not emulator.pages.sessions  # logged out
        asked = emulator.pages.asked
    egm = inlet.stream("egm")
    np.testing.assert_allclose(egm[:, :6], np.tile(ANGLES, (len(egm), 1)), atol=1e-12)
    columns = inlet.of("egm")[0].stream.names
    assert (egm[:, columns.index("tool.force_x")] == 1.5).all()
    assert (egm[:, columns.index("tool.torque_z")] == -0.25).all()
    assert ("robot.move_index" in columns) == (robotware == 7)
    assert not np.isnan(egm[:, columns.index("robot.motors_on") :]).any()
    states = inlet.stream("controller")
    assert (states == [1, 1, 1, 0, 1]).all()
    energy = inlet.of("energy")[-1]
    assert energy.values[0, 1:4].tolist() == pytest.approx([200.0, 1.0, 0.0])
    assert energy.values[0, 4] == pytest.approx(5.0)
    assert energy.asked < energy.arrival
    assert_only_late(inlet)
    assert inlet.identities[-1].firmware.startswith(f"RobotWare {robotware}")
    assert {k.split()[0] for k in asked} == {"GET"}
    assert emulator.counts["heard"] == 0


async def test_what_the_emulator_made_is_what_came():
    async with emulated() as (emulator, place), running(place, web=[]) as (inlet, _):
        await inlet.until(lambda o: o.account.received > 50)
        for kind in ("loss", "duplicate", "reorder", "half_frame", "garbage"):
            emulator.inject(Fault(kind, probability=0.05))
        await inlet.until(lambda o: emulator.counts["made"] > 500)
        for kind in ("loss", "duplicate", "reorder", "half_frame", "garbage"):
            emulator.inject(Fault(kind, probability=0))
        calm = inlet.account.received
        await inlet.until(lambda o: o.account.received > calm + 20)
        counts, account = emulator.counts, inlet.account
    gone = counts["loss"] + counts["half_frame"] + counts["reorder"]
    assert min(counts[k] for k in ("loss", "duplicate", "reorder", "half_frame", "garbage")) > 0
    assert account.missed == {"gap": gone}
    assert account.counters["malformed"] == counts["half_frame"] + counts["garbage"]
    assert account.counters["late packets"] + account.counters["duplicates"] == counts["reorder"] + counts["duplicate"]
    assert inlet.resets == []


async def test_states_that_change_are_reported():
    async with emulated() as (emulator, place), running(place, web_rate="10 Hz") as (inlet, _):
        await inlet.until(lambda o: len(o.of("controller")) > 1)
        emulator.disturb({"motors": "off"})
        await inlet.until(lambda o: "controller_state" in o.kinds())
        emulator.disturb({"program": "off"})
        await inlet.until(lambda o: "program_state" in o.kinds())
    assert inlet.texts("controller_state") == ["controller: motoron → motoroff"]


async def test_pages_that_fail_leave_the_stream_alone_and_are_tried_again():
    async with emulated() as (_, place), running(place, password="wrong") as (inlet, task):
        await inlet.until(lambda o: o.account.received > 50 and o.account.counters["web failures"] > 0)
        assert not task.done()
    assert any("user 'Default User' or the password is refused" in text for text in inlet.texts())


async def test_a_page_that_comes_in_parts_is_read_to_its_end_and_a_silent_logout_is_no_error():
    page = b"<html>" + b" " * 400_000 + b"</html>"
    head = b"HTTP/1.1 200 OK\r\nSet-Cookie: -http-session-=1\r\nContent-Length: %d\r\n\r\n"

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(head % len(page) + page)
        await asyncio.Event().wait()

    async with clients(talk) as (address, _):
        port = int(address.rpartition(":")[2])
        asked = {"host": "127.0.0.1", "port": port, "tls": False, "timeout": "1 s"}
        async with session(AbbSettings.model_validate(asked)) as web:
            assert await web.get("/rw/system") == page


async def test_a_controller_without_energy_keeps_its_states():
    async with emulated(energy="no") as (_, place):
        async with running(place, egm=[], web_rate="10 Hz") as (inlet, _):
            await inlet.until(lambda o: len(o.of("controller")) > 5)
        with pytest.raises(WrongDeviceError, match="HTTP 404"):
            await driver(place, egm=[], web=["energy"]).run()
    assert inlet.kinds() == ["energy_failed"]
    assert "the controller has no energy page (/rw/system/energy)" in inlet.texts()[0]
    assert_only_late(inlet)


async def test_pages_that_fail_again_in_the_same_way_are_told_again(monkeypatch):
    async with emulated() as (emulator, place), running(place, web_rate="10 Hz") as (inlet, _):
        well = emulator.pages.answer

        def without_mode(method, target, fields):
            return (405, {}, b"") if target == MODE else well(method, target, fields)

        for times in (1, 2):
            seen = len(inlet.of("controller"))
            await inlet.until(lambda o, seen=seen: len(o.of("controller")) > seen + 5)
            monkeypatch.setattr(emulator.pages, "answer", without_mode)
            await inlet.until(lambda o, times=times: o.kinds().count("web_failed") == times)
            monkeypatch.setattr(emulator.pages, "answer", well)


def unblocking() -> socket.socket:
    opened = socket.socket(type=socket.SOCK_DGRAM)
    opened.setblocking(False)
    return opened


async def is_taken(port: int) -> None:
    """Return once a UDP port of this machine is listened at."""
    while True:
        with socket.socket(type=socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                return
        await asyncio.sleep(0)


async def test_an_outage_ends_the_source_and_a_new_start_counts_what_was_lost():
    async with emulated() as (emulator, place):
        arm = driver(place, web=[], timeout="500 ms")
        inlet, first = arm.inlet, asyncio.create_task(arm.run())
        await inlet.until(lambda o: o.account.received > 10)
        with unblocking() as stranger:  # of whom nothing is told: the address is right
            stranger.bind(("127.0.0.2", 0))
            stranger.sendto(b"?", ("127.0.0.1", int(str(place["egm_port"]))))
        heard = inlet.account.received
        await inlet.until(lambda o: o.account.counters["strangers"] and o.account.received > heard + 50)
        emulator.inject(Fault("loss"))
        with pytest.raises(ConnectError, match=r"no EGM packet .* EGMStreamStart"):
            await asyncio.wait_for(first, PATIENCE)
        seen = inlet.account.received
        async with once(arm):
            await is_taken(int(str(place["egm_port"])))  # else packets that find no socket are lost, too
            emulator.inject(Fault("loss", probability=0))
            await inlet.until(lambda o: o.account.received > seen)
    assert inlet.account.missed["outage"] == emulator.counts["loss"] > 50
    assert len(inlet.identities) == 2
    assert inlet.resets == []


async def test_a_second_robot_at_the_port_is_left_out_until_the_first_one_ends():
    """Two robots of one controller, whose EGM goes to one port by mistake."""
    place, account, taken = ("127.0.0.1", free_port()), Account(), list[bytes]()
    port = listening(place[0], *place, account, lambda packets, _: taken.extend(packets))
    with unblocking() as first, unblocking() as second:
        async with port:
            for n in range(1, 6):
                first.sendto(b"1", place)
                second.sendto(b"2", place)
                await eventually(lambda n=n: account.counters["packets of a second robot"] == n)
            assert taken == [b"1"] * 5
            await eventually(lambda: second.sendto(b"2", place) and b"2" in taken, "the second one alone")


async def test_data_that_are_not_egm_are_told():
    port = free_port()
    arm = driver({"host": "127.0.0.1", "bind": "127.0.0.1", "egm_port": port}, web=[], timeout="300 ms")
    with unblocking() as other:
        run = asyncio.create_task(arm.run())
        await is_taken(port)
        other.sendto(b"hello", ("127.0.0.1", port))
        with pytest.raises(ConnectError, match=r"no EGM packet .*, but other data from it: 5 bytes that are not EGM"):
            await run


async def test_a_controller_with_another_sample_rate_than_the_settings_is_not_too_slow():
    events: list[Event] = []
    async with emulated(rate="125") as (_, place):
        arm = AbbSettings.model_validate(place | {"web": []})
        source = Source("arm", AbbDriver, arm, time.time_ns, lambda _: None, events.append)
        async with doing(source.run()):
            await eventually(lambda: source.status()["streams"]["egm"]["nominal_hz"] == 125)
    told = "the controller sends 125 packets a second, 'rate' says 250 Hz: see \\SampleRate of EGMStreamStart"
    assert [event.text for event in events if event.kind == "rate"] == [told]


async def test_only_the_robots_own_packets_are_taken():
    async with emulated() as (_, place):
        arm = driver(place, web=[], host="127.0.0.9", timeout="1 s")
        told = r"no EGM packet from 127\.0\.0\.9 .* 127\.0\.0\.1 sends to that port: is it this robot's address\?"
        with pytest.raises(ConnectError, match=told):
            await arm.run()
    assert arm.inlet.account.counters["strangers"] > 0
    assert arm.inlet.account.received == 0


async def test_who_is_there():
    async with emulated() as (_, place):
        found = await driver(place).identify()
        assert (found.maker, found.model, found.firmware) == ("ABB", "OmniCore", "RobotWare 7.15.0")
        assert (await driver(place, web=[]).identify()).model == "EGM stream"
        with pytest.raises(DeviceError, match="refused"):
            await driver(place, password="no").identify()
        with pytest.raises(ConnectError, match="cannot be read"):
            await driver(place, port=1).identify()


async def test_pages_over_https(tmp_path):
    own, key = await asyncio.to_thread(self_signed, tmp_path, "controller", subjectAltName="IP:127.0.0.1")
    pem = tmp_path / "pair.pem"
    pem.write_text(key.read_text() + own.read_text())
    async with emulated(certificate=str(pem)) as (_, place):
        for certificate in (None, str(own)):
            assert (await driver(place, tls=None, certificate=certificate).identify()).model == "OmniCore"
