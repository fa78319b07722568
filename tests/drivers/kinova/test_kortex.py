"""The driver over Kortex, with a stand-in for the vendor's library: the wheel is not on the package index."""

from __future__ import annotations

import asyncio
import sys
import threading
from types import ModuleType, SimpleNamespace

import pytest

from cellwatt.errors import ConfigError, ConnectError, DeviceError
from cellwatt_drivers.kinova import kortex, registers
from tests.patience import PATIENCE, eventually

from ..inlet import CollectingInlet
from .rig import driver, of, running

FEEDBACK = SimpleNamespace(
    base=SimpleNamespace(
        active_state=7, fault_bank_a=0x800001, warning_bank_a=4,
        arm_voltage=24.0, arm_current=1.25, temperature_cpu=45.0, temperature_ambient=38.0,
        **{
            f"tool_{part}{axis}": 10.0 * i + j
            for i, part in enumerate(
                ("pose_", "pose_theta_", "twist_linear_", "twist_angular_", "external_wrench_force_",
                 "external_wrench_torque_")
            )
            for j, axis in enumerate("xyz")
        },
    ),
    actuators=[
        SimpleNamespace(position=12.5, velocity=-1.0, torque=-3.25, current_motor=0.5, temperature_motor=36.0 + i)
        for i in range(7)
    ],
)  # fmt: skip


class Arm:
    """What the stand-in's client does; ``said`` are the calls that reach an arm."""

    def __init__(self):
        self.said: list[str] = []
        self.failure: Exception | None = None
        self.gate: threading.Event | None = None

    def call(self, name: str):
        self.said.append(name)
        if self.gate is not None:
            assert self.gate.wait(PATIENCE)
        if self.failure is not None:
            raise self.failure
        return FEEDBACK


@pytest.fixture
def arm(monkeypatch) -> Arm:
    """The stand-in in the place of ``kortex_api``."""
    arm = Arm()

    class Router:
        basicErrorCallback = staticmethod(print)

        def __init__(self, transport, callback):
            pass

    parts = {
        "": {},
        ".autogen": {},
        ".autogen.messages": {"Session_pb2": SimpleNamespace(CreateSessionInfo=SimpleNamespace)},
        ".autogen.client_stubs": {},
        ".autogen.client_stubs.BaseCyclicClientRpc": {
            "BaseCyclicClient": lambda router: SimpleNamespace(
                RefreshFeedback=lambda device, options: arm.call("RefreshFeedback")
            )
        },
        ".RouterClient": {"RouterClient": Router, "RouterClientSendOptions": SimpleNamespace},
        ".SessionManager": {
            "SessionManager": lambda router: SimpleNamespace(
                CreateSession=lambda info: arm.call(f"CreateSession {info.username}"),
                CloseSession=lambda options: arm.call("CloseSession"),
            )
        },
        ".TCPTransport": {
            "TCPTransport": lambda: SimpleNamespace(
                connect=lambda host, port: arm.call(f"connect {port}"), disconnect=lambda: arm.call("disconnect")
            )
        },
    }
    for name, content in parts.items():
        module = ModuleType(f"kortex_api{name}")
        module.__path__ = []
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, f"kortex_api{name}", module)
    return arm


async def test_feedback_becomes_the_same_streams(arm):
    changes = {"protocol": "kortex", "read": ["arm", "joints", "tool"]}
    async with running(10000, **changes) as (inlet, _):
        await inlet.until(lambda o: len(of(o, "motion")) > 5)
    await eventually(lambda: "disconnect" in arm.said)
    assert arm.said[:2] == ["connect 10000", "CreateSession admin"]
    assert arm.said[-2:] == ["CloseSession", "disconnect"]
    assert set(arm.said[2:-2]) == {"RefreshFeedback"}
    refreshed = arm.said.count("RefreshFeedback")
    assert refreshed <= len(of(inlet, "motion")) + 2  # one for both blocks; one may be under way
    assert of(inlet, "arm")[0].values[0].tolist() == [24, 1.25, 30, 45, 38, 7, 0x800001, 4]
    motion = dict(zip(of(inlet, "motion")[0].stream.names, of(inlet, "motion")[0].values[0], strict=True))
    assert motion["joint_7.torque"] == -3.25
    assert motion["joint_3.temperature"] == 38.0
    assert motion["tool.y"] == 1.0
    assert motion["tool.torque_z"] == 52.0
    assert of(inlet, "arm")[0].asked == of(inlet, "motion")[0].asked


def test_six_actuators_leave_the_seventh_empty():
    six = SimpleNamespace(base=FEEDBACK.base, actuators=FEEDBACK.actuators[:6])
    names = registers.joints(40.0, 7, True).stream.names
    found = dict(zip(names, registers.motion_values(kortex.motion_registers(six), 7), strict=True))
    assert (found["joint_6.current"], found["joint_7.current"]) == (0.5, 0.0)


@pytest.mark.parametrize(
    ("failure", "kind", "why"),
    [
        (TimeoutError(), ConnectError, "no answer within"),
        (ConnectionRefusedError(111, "Connection refused"), ConnectError, "Connection refused"),
        (RuntimeError("bad password"), DeviceError, "RuntimeError: bad password"),
    ],
)
async def test_failures_are_the_sources(arm, failure, kind, why):
    arm.failure = failure
    with pytest.raises(kind, match=why):
        await driver(10000, CollectingInlet(), protocol="kortex").run()


async def test_a_blocked_call_holds_up_neither_the_loop_nor_its_end(arm):
    arm.gate = threading.Event()
    task = asyncio.create_task(driver(10000, CollectingInlet(), protocol="kortex").run())
    await eventually(lambda: arm.said)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert arm.said == ["connect 10000"]
    arm.gate.set()
    await eventually(lambda: "disconnect" in arm.said)


def test_without_the_vendors_library_it_says_so():
    if "kortex_api" in sys.modules:
        pytest.skip("kortex_api is installed")
    with pytest.raises(ConfigError, match="install its wheel from Kinova, or use protocol modbus"):
        driver(10000, CollectingInlet(), protocol="kortex")
