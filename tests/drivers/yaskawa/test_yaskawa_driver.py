from __future__ import annotations

import asyncio

import numpy as np
import pytest

from cellwatt.errors import DeviceError, ProtocolError, WrongDeviceError
from cellwatt_drivers.yaskawa import YaskawaDriver, wire
from cellwatt_drivers.yaskawa.emulated_robot import EmulatedRobot
from cellwatt_drivers.yaskawa.payload import Alarm, encode_axes
from cellwatt_drivers.yaskawa.robotstate import TorqueWatch
from tests.patience import eventually

from .rig import ANGLES, PULSES, TORQUES, Inlet, emulated, running, settings


async def test_counts_become_radians_and_newton_metres():
    async with emulated() as (_, port), running(settings(port, rate="100 Hz")) as (_, inlet, _):
        await eventually(lambda: len(inlet.of("torque")) > 3)
    # Whole pulses and whole per cent are all that the wire carries.
    half_pulse = np.radians(0.5 / np.abs(PULSES))
    assert np.all(np.abs(inlet.of("position")[0].values[0] - ANGLES) <= half_pulse)
    assert inlet.of("torque")[0].values[0] == pytest.approx(TORQUES)


async def test_answers_with_fewer_axes_are_read_or_told_at_the_start(monkeypatch):
    for name in ("pulses", "torques"):
        monkeypatch.setattr(EmulatedRobot, name, lambda *_: (1000,) * 4)
    few = {"axes": 4, "pulses_per_degree": PULSES[:4], "rated_torque": None}
    async with emulated() as (_, port), running(settings(port, **few)) as (_, inlet, _):
        await eventually(lambda: inlet.of("torque") and inlet.of("position"))
        with pytest.raises(ProtocolError, match=rf":{port}, position: the controller gives 4 axes, the settings say 6"):
            await YaskawaDriver("arm", settings(port), Inlet()).identify()


async def test_state_channels_and_identity():
    async with emulated() as (_, port), running(settings(port)) as (driver, inlet, _):
        await eventually(lambda: bool(inlet.of("state")))
    (identity,) = inlet.identities
    assert (identity.maker, identity.model, identity.firmware) == ("Yaskawa", "YRC1000", "EMULATED")
    assert identity.notes["axes"] == "S L U R B T"
    stream = next(s for s in driver.streams if s.name == "state")
    state = dict(zip(stream.names, inlet.of("state")[0].values[0], strict=True))
    on = {name for name, value in state.items() if value}
    assert on == {"robot.running", "robot.servo_on", "robot.remote", "robot.play", "robot.automatic"}
    assert state["robot.alarm_code"] == 0.0


@pytest.mark.parametrize(("counts", "told"), [((300, -300), False), ((1001, 0), True), ((-1001, 0), True)])
def test_ten_times_the_rated_torque_is_the_limit(counts, told):
    inlet = Inlet()
    watch = TorqueWatch("arm", inlet, 0.01)
    for _ in range(2):
        watch.see(encode_axes((*counts, 0, 0, 0, 0)))
    assert len(inlet.events) == told
    watch.see(encode_axes((0,) * 6))
    watch.see(encode_axes((*counts, 0, 0, 0, 0)))
    assert len(inlet.events) == 2 * told


async def test_an_alarm_is_read_told_once_and_its_end_too():
    async with emulated() as (emulator, port), running(settings(port, status_rate="50 Hz")) as (_, inlet, _):
        await eventually(lambda: len(inlet.of("state")) > 2)
        assert wire.Request(wire.ALARM) not in emulator.asked
        emulator.alarm = Alarm(4315, 3, time="2024/05/06 07:08", name="COLLISION DETECT")
        await eventually(lambda: inlet.of("state")[-1].values[0, -1] == 4315)
        seen = len(inlet.of("state"))
        await eventually(lambda: len(inlet.of("state")) > seen + 3)
        emulator.alarm = Alarm(0)
        await eventually(lambda: inlet.of("state")[-1].values[0, -1] == 0)
    assert inlet.kinds() == ["controller_alarm", "controller_alarm_cleared"]
    assert "4315 'COLLISION DETECT'" in inlet.texts()[0]


async def test_the_tool_pose_in_metres_and_radians():
    async with emulated() as (_, port), running(settings(port, read=["cartesian"])) as (_, inlet, _):
        await eventually(lambda: len(inlet.of("cartesian")) > 1)
    pose = inlet.of("cartesian")[0].values[0]
    assert pose[:3] == pytest.approx([0.123456, -0.05, 0.789012], abs=1e-9)
    assert pose[3:] == pytest.approx([np.pi, -np.pi / 2, 0.0], abs=1e-6)


async def test_a_slow_controller_loses_slots_not_deadlines():
    # Two answers of 15 ms do not fit 20 ms: every other slot or so is missed, and the reason says why.
    changes = {"read": ["position", "torque"], "timeout": "500 ms"}
    async with emulated(answer_ms="15") as (_, port), running(settings(port, **changes)) as (_, inlet, _):
        await eventually(lambda: len(inlet.of("torque")) >= 20)
    assert inlet.account.missed["slow answers"] + inlet.account.missed["host stalled"] > 0
    assert set(inlet.account.missed) <= {"slow answers", "merged tick", "host stalled"}  # of a busy test machine
    asked = [r.asked for r in inlet.of("position") if r.asked is not None]
    assert np.median(np.diff(asked)) > 25e6


class Echo(asyncio.DatagramProtocol):
    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, addr):
        self.transport.sendto(data, addr)


async def test_an_echo_server_is_the_wrong_device():
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(Echo, local_addr=("127.0.0.1", 0))
    port = transport.get_extra_info("sockname")[1]
    try:
        with pytest.raises(WrongDeviceError, match="not with High-Speed Ethernet Server frames"):
            await YaskawaDriver("arm", settings(port, timeout="20 ms"), Inlet()).run()
    finally:
        transport.close()


async def test_a_robot_with_fewer_axes_is_the_wrong_device():
    async with emulated(pulses_per_degree="1,1,1,1", rated_torque="1,1,1,1") as (_, port):
        with pytest.raises(WrongDeviceError, match=r"has 4 axes \(S L U R\), the settings say 6"):
            await YaskawaDriver("arm", settings(port), Inlet()).identify()


async def test_a_control_group_that_is_not_there_is_refused_at_once():
    async with emulated() as (_, port):
        with pytest.raises(DeviceError, match=r"refuses to give position.*control_group"):
            await YaskawaDriver("arm", settings(port, control_group=2), Inlet()).run()
