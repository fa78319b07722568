"""A Kortex session that only refreshes feedback, given as the registers of the Modbus map.

Both carry the same 32-bit floats, so that everything behind the connection is one. The vendor's library blocks: all
its calls are made in one thread of their own.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any

from cellwatt.errors import ConnectError, DeviceError, SourceError
from cellwatt_drivers.kinova.link import Answer
from cellwatt_drivers.kinova.registers import ARM, MOST_JOINTS, encode
from cellwatt_drivers.shared.polling import NoAnswerError

PORT = 10000
_SESSION_MS = 10_000
_CONNECTION_MS = 2_000
_ACTUATOR = ("position", "velocity", "torque", "current_motor", "temperature_motor")
_TOOL = (
    "tool_pose_",
    "tool_pose_theta_",
    "tool_twist_linear_",
    "tool_twist_angular_",
    "tool_external_wrench_force_",
    "tool_external_wrench_torque_",
)


class KortexLink:
    """Feedback of an arm; see ``Link``. One refresh serves both blocks of a slot."""

    def __init__(self, refresh: Callable[[], Awaitable[Any]], now: Callable[[], int]) -> None:
        self._refresh = refresh
        self._now = now
        self._fresh: tuple[Any, int, int] | None = None

    async def read(self, first: int, count: int) -> Answer:
        """Read ``count`` registers from ``first`` on. Raises ``NoAnswerError``, ``ConnectError`` or ``DeviceError``."""
        if first == ARM[0] or self._fresh is None:
            asked = self._now()
            feedback = await self._refresh()
            found = (feedback, asked, self._now())
            self._fresh = found if first == ARM[0] else None
        else:
            found, self._fresh = self._fresh, None
        feedback, asked, arrival = found
        words = arm_registers(feedback) if first == ARM[0] else motion_registers(feedback)
        return Answer(words[:count], asked, arrival)


def arm_registers(feedback: Any) -> list[int]:
    """Return the registers of the arm's block."""
    base = feedback.base
    words = [1 << int(base.active_state), 0]
    for flags in (base.fault_bank_a, base.warning_bank_a):
        words += [flags & 0xFFFF, flags >> 16]
    return words + encode([base.arm_current, base.arm_voltage, base.temperature_cpu, base.temperature_ambient])


def motion_registers(feedback: Any) -> list[int]:
    """Return the registers of the block of joints and tool; 0 for joints that the arm lacks."""
    actuators = list(feedback.actuators)[:MOST_JOINTS]
    absent = [0.0] * (MOST_JOINTS - len(actuators))
    values: list[float] = []
    for name in _ACTUATOR:
        values += [getattr(actuator, name) for actuator in actuators] + absent
    values += [getattr(feedback.base, f"{name}{axis}") for name in _TOOL for axis in "xyz"]
    return encode(values)


@asynccontextmanager
async def open_kortex(
    host: str, port: int, user: str, password: str, timeout: float, now: Callable[[], int]
) -> AsyncIterator[KortexLink]:
    """Open a session of one's own. Raises ``ConnectError`` or ``DeviceError``."""
    place = f"{host}:{port}"
    loop = asyncio.get_running_loop()
    thread = ThreadPoolExecutor(1, thread_name_prefix=f"kortex {place}")
    session = _Session(host, port, timeout)

    async def call(function: Callable[[], Any]) -> Any:
        try:
            return await loop.run_in_executor(thread, function)
        except Exception as error:  # the library's exceptions have no common class
            raise _meaning(place, timeout, error) from error

    try:
        await call(partial(session.open, user, password))
        yield KortexLink(partial(call, session.refresh), now)
    finally:
        thread.submit(session.close)  # behind a call that is still waiting for its time-out
        thread.shutdown(wait=False)


class _Session:
    """The vendor's objects; all methods block."""

    def __init__(self, host: str, port: int, timeout: float) -> None:
        self._host, self._port = host, port
        self._milliseconds = round(timeout * 1e3)
        self._transport: Any = None
        self._manager: Any = None
        self._cyclic: Any = None
        self._options: Any = None

    def open(self, user: str, password: str) -> None:
        from kortex_api.autogen.client_stubs.BaseCyclicClientRpc import BaseCyclicClient
        from kortex_api.autogen.messages import Session_pb2
        from kortex_api.RouterClient import RouterClient, RouterClientSendOptions
        from kortex_api.SessionManager import SessionManager
        from kortex_api.TCPTransport import TCPTransport

        self._transport = TCPTransport()
        router = RouterClient(self._transport, RouterClient.basicErrorCallback)
        self._transport.connect(self._host, self._port)
        self._options = RouterClientSendOptions()
        self._options.timeout_ms = self._milliseconds
        info = Session_pb2.CreateSessionInfo()
        info.username, info.password = user, password
        info.session_inactivity_timeout, info.connection_inactivity_timeout = _SESSION_MS, _CONNECTION_MS
        manager = SessionManager(router)
        manager.CreateSession(info)
        self._manager = manager
        self._cyclic = BaseCyclicClient(router)

    def refresh(self) -> Any:
        return self._cyclic.RefreshFeedback(0, self._options)

    def close(self) -> None:
        with suppress(Exception):  # a session that cannot be closed in order ends by its own time-out
            if self._manager is not None:
                self._manager.CloseSession(self._options)
        with suppress(Exception):
            if self._transport is not None:
                self._transport.disconnect()


def _meaning(place: str, timeout: float, error: Exception) -> SourceError:
    if isinstance(error, TimeoutError):
        return NoAnswerError(f"{place} gave no answer within {timeout:g} s")
    if isinstance(error, OSError):
        return ConnectError(f"nobody answers at TCP {place}: {error.strerror or error}; check the address")
    return DeviceError(f"{place}: {type(error).__name__}: {' '.join(str(error).split())}")
