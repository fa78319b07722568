"""Polls a Yaskawa controller over the High-Speed Ethernet Server."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Annotated, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from cellwatt.arrays import Float
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import ConnectError, DeviceError, ProtocolError
from cellwatt.host import Host
from cellwatt.quantity import Fraction, Hertz, Radians, Seconds
from cellwatt.slots import Slots
from cellwatt_drivers.shared.choice import Chosen
from cellwatt_drivers.shared.polling import deliver
from cellwatt_drivers.yaskawa import greeting, payload, polls, wire
from cellwatt_drivers.yaskawa.link import Exchange, Link, TakeLate, UnansweredError, open_link
from cellwatt_drivers.yaskawa.polls import Poll
from cellwatt_drivers.yaskawa.robotstate import AlarmWatch, TorqueWatch

T = TypeVar("T")
Finite = Annotated[float, Field(allow_inf_nan=False)]
Read = Literal["position", "torque", "cartesian", "status", "alarm"]

_ALARM = wire.Request(wire.ALARM)


class YaskawaSettings(SourceSettings):
    """A DX200, YRC1000 or FS100 controller and its robot."""

    device_parts: ClassVar[tuple[str, ...]] = ("control_group",)

    host: Host
    """Address of the controller."""
    port: int = Field(wire.PORT, ge=1, le=65535)
    """UDP port of the robot division."""
    read: Chosen[Read] = ("position", "torque", "status", "alarm")
    """Groups to read; ``alarm`` is read while the status shows an alarm."""
    rate: Hertz = 50.0
    """Polls per second of position, of torque and of the Cartesian position, each."""
    status_rate: Hertz = 2.0
    """Polls per second of the status; rounded so that ``rate`` is a whole multiple of it."""
    control_group: int = Field(1, ge=1, le=8)
    """Robot of the controller: 1 is R1."""
    axes: int = Field(6, ge=1, le=8)
    """Joints to read, in the controller's order (S L U R B T E …)."""
    pulses_per_degree: tuple[Finite, ...] = ()
    """Encoder pulses per degree of each joint, negative if the joint turns the other way; for ``position``."""
    coupling: tuple[tuple[Finite, ...], ...] | None = None
    """Matrix from motor angles to joint angles, row by row, for wrist axes that move each other."""
    zero: tuple[Radians, ...] | None = None
    """Angle of each joint at pulse 0, added last."""
    rated_torque: tuple[Finite, ...] | None = None
    """Rated torque of each joint, Nm at 100 %; without it torque is a share of the rated torque (``torque_ratio``)."""
    torque_count: Fraction = 0.01
    """Value of one count in the torque answer, as a share of the rated torque."""
    timeout: Seconds = Field(0.05, gt=0)
    """Longest wait for an answer; an FS100 needs 200 ms."""
    retries: int = Field(2, ge=0, le=10)
    """Most repeated requests, within the poll's period."""
    silence: Seconds = Field(2.0, gt=0)
    """Longest time without a good answer: after it the source is down and is opened again."""

    @field_validator("pulses_per_degree", "rated_torque")
    @classmethod
    def _not_zero(cls, value: tuple[Finite, ...] | None) -> tuple[Finite, ...] | None:
        if value is not None and 0.0 in value:
            raise ValueError("no value may be zero")
        return value

    @model_validator(mode="after")
    def _fits(self) -> YaskawaSettings:
        if "alarm" in self.read and "status" not in self.read:
            raise ValueError("'alarm' is read when the status shows one: add 'status' to read")
        if "position" in self.read and len(self.pulses_per_degree) != self.axes:
            raise ValueError(f"pulses_per_degree needs one value for each of the {self.axes} axes to read position")
        for name in ("zero", "rated_torque", "coupling"):
            value = getattr(self, name)
            if value is not None and len(value) != self.axes:
                raise ValueError(f"{name} has {len(value)} entries for {self.axes} axes")
        if self.coupling is not None and any(len(row) != self.axes for row in self.coupling):
            raise ValueError(f"coupling must be {self.axes} rows of {self.axes} values")
        if self.status_rate > self.rate and not {"position", "torque", "cartesian"}.isdisjoint(self.read):
            raise ValueError(f"status_rate {self.status_rate:g} Hz is above rate {self.rate:g} Hz")
        return self


class YaskawaDriver(Driver[YaskawaSettings]):
    """One controller; several run concurrently on one loop.

    A slot falls due ``rate`` times a second. In it position, torque and Cartesian position are requested one after the
    other, never two at once; each is its own stream, stamped between its request and its answer. Every due poll is
    delivered, or counted as missed with its reason.
    """

    Settings = YaskawaSettings
    title = "Yaskawa robots over the High-Speed Ethernet Server (DX200, YRC1000, FS100)"
    emulator = "cellwatt_drivers.yaskawa.emulator:YaskawaEmulator"
    writes = (
        "read requests only (service 0x01, no data) to UDP port 10040: status 0x72, axis names 0x74, position 0x75, "
        "torque 0x77, alarm 0x70, system information 0x89",
    )

    def __init__(self, name: str, settings: YaskawaSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        rate = settings.status_rate if set(settings.read) <= {"status", "alarm"} else settings.rate
        self._polls = _polls(settings, rate)
        self._period = round(1e9 / rate)
        self._alarms = AlarmWatch(name, inlet)
        self._torques = TorqueWatch(name, inlet, settings.torque_count)
        self._slot = 0
        self._slots = Slots(rate, self._miss_slots)
        self._last_answer = 0
        self._failure: UnansweredError | None = None
        self._newest: dict[str, int] = {}
        """Twice the middle of the newest emitted exchange, ns, by stream."""

    @property
    def streams(self) -> tuple[Stream, ...]:
        """``position``, ``torque``, ``cartesian`` and ``state``, if selected."""
        return tuple(poll.stream for poll in self._polls)

    async def identify(self) -> Identity:
        """Read system information and axis names. Raises ``SourceError``."""
        async with self._open() as link:
            return await self._greet(link)

    async def run(self) -> None:
        """See ``Driver.run``."""
        async with self._open() as link:
            self.inlet.connected(await self._greet(link))
            self._last_answer = time.monotonic_ns()
            async with self._slots as slots:
                async for beat in slots:
                    await self._serve_slot(link, beat.deadline)
                    self._check_silence(link)

    def _open(self) -> AbstractAsyncContextManager[Link]:
        return open_link(self.settings.host, self.settings.port, self.settings.timeout, self.inlet)

    async def _greet(self, link: Link) -> Identity:
        return await greeting.greet(link, self.settings.control_group, self.settings.axes, self._polls)

    def _miss_slots(self, slots: int, reason: str) -> None:
        before, self._slot = self._slot, self._slot + slots
        due = sum(self._slot // poll.every - before // poll.every for poll in self._polls)
        self.inlet.account.lose(due, reason)

    async def _serve_slot(self, link: Link, deadline: int) -> None:
        until = deadline + self._period
        self._slot += 1
        for poll in self._polls:
            if self._slot % poll.every == 0:
                await self._serve(link, poll, until)

    async def _serve(self, link: Link, poll: Poll, until: int) -> None:
        missed = False
        state = poll.request.command == wire.STATUS

        def late(exchange: Exchange) -> None:
            nonlocal missed
            # If a newer sample was emitted, an older one would turn the stream's time back.
            if missed and exchange.asked + exchange.arrival > self._newest.get(poll.stream.name, 0):
                missed = False
                self._emit_late(link, poll, exchange)

        try:
            exchange, values = await self._ask(link, poll.request, poll.values, until, None if state else late)
        except UnansweredError as failure:
            self._miss(failure)
            missed = failure.reason == "timeout"
        else:
            if poll.request.command == wire.TORQUE:
                self._torques.see(exchange.answer.data)
            if state and "alarm" in self.settings.read:
                status = payload.decode_status(exchange.answer.data)
                values = np.append(values, await self._alarm_code(link, status, until))
            self._emit(poll.stream, exchange, values)

    async def _alarm_code(self, link: Link, status: dict[str, bool], until: int) -> float:
        """Code of the latest alarm, 0 without one, NaN if it could not be read; reports a changed alarm."""
        alarm = payload.Alarm(0)
        if status["alarm"] or status["error"]:
            try:
                _, alarm = await self._ask(link, _ALARM, payload.decode_alarm, until)
            except UnansweredError as failure:
                self._note(failure)
                return float("nan")
        self._alarms.see(alarm)
        return float(alarm.code)

    async def _ask(
        self,
        link: Link,
        request: wire.Request,
        decode: Callable[[bytes], T],
        until: int,
        late: TakeLate | None = None,
    ) -> tuple[Exchange, T]:
        exchange = await link.ask(request, self.settings.retries, until, late)
        try:
            found = decode(exchange.answer.data)
        except ProtocolError as error:
            link.count_malformed()
            raise UnansweredError("malformed", str(error)) from error
        self._last_answer = time.monotonic_ns()
        return exchange, found

    def _emit(self, stream: Stream, exchange: Exchange, values: Float, quality: Quality = Quality.GOOD) -> None:
        self._newest[stream.name] = exchange.asked + exchange.arrival
        deliver(self.inlet, stream, values, exchange.asked, exchange.arrival, quality)

    def _emit_late(self, link: Link, poll: Poll, exchange: Exchange) -> None:
        """Emit a sample that arrived after its time-out, with its actual times."""
        try:
            values = poll.values(exchange.answer.data)
        except ProtocolError:
            link.count_malformed()
            return
        self._last_answer = time.monotonic_ns()
        self.inlet.account.late(1, "timeout")
        self._emit(poll.stream, exchange, values, Quality.LATE)

    def _miss(self, failure: UnansweredError) -> None:
        self.inlet.account.lose(1, failure.reason)
        self._note(failure)

    def _note(self, failure: UnansweredError) -> None:
        if failure.reason == "device error" and str(failure) != str(self._failure):
            self.inlet.event("device_error", f"{self.name}: the controller refuses a read: {failure}")
        self._failure = failure

    def _check_silence(self, link: Link) -> None:
        silence = (time.monotonic_ns() - self._last_answer) * 1e-9
        if silence > self.settings.silence and self._failure is not None:
            kind = DeviceError if self._failure.reason == "device error" else ConnectError
            raise kind(f"no good answer from {link.place} for {silence:.1f} s; the last: {self._failure}")


def _polls(settings: YaskawaSettings, rate: float) -> tuple[Poll, ...]:
    """Polls of the slots, ``rate`` a second: those of each slot in the order of ``read``, and the status."""
    n, group = settings.axes, settings.control_group
    found = []
    for name in settings.read:
        if name == "position":
            angles = polls.motor_angles(settings.pulses_per_degree, settings.coupling, settings.zero)
            found.append(polls.position(group, rate, n, angles))
        elif name == "torque":
            found.append(polls.torque(group, rate, n, settings.rated_torque, settings.torque_count))
        elif name == "cartesian":
            found.append(polls.cartesian(group, rate))
    if "status" in settings.read:
        found.append(polls.status(rate, max(1, round(rate / settings.status_rate)), "alarm" in settings.read))
    return tuple(found)
