"""Frames of the High-Speed Ethernet Server and the data in them."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from cellwatt.errors import ProtocolError
from cellwatt_drivers.yaskawa import payload, wire
from cellwatt_drivers.yaskawa.robotstate import AlarmWatch
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target


def run(data: bytes) -> None:
    """As a datagram, and as the data of every kind of answer."""
    with suppress(ProtocolError):
        answer = wire.decode_answer(data)
        assert wire.decode_answer(wire.encode_answer(answer)) == answer
        assert "\n" not in answer.text
        assert isinstance(answer.busy, bool)
        _data(answer.data)
    with suppress(ProtocolError):
        request, number = wire.decode_request(data)
        assert wire.decode_request(wire.encode_request(request, number)) == (request, number)
    _data(data)


def _data(data: bytes) -> None:
    with suppress(ProtocolError):
        status = payload.decode_status(data)
        written = payload.encode_status(*(name for name, is_set in status.items() if is_set))
        assert payload.decode_status(written) == status
    for kind in (payload.PULSE, payload.BASE):
        with suppress(ProtocolError):
            axes = payload.decode_position(data, kind)
            assert payload.decode_position(payload.encode_position(kind, axes), kind) == axes
    with suppress(ProtocolError):
        assert payload.encode_axes(payload.decode_axes(data)) == data
    with suppress(ProtocolError):
        payload.decode_axis_names(data)
    with suppress(ProtocolError):
        payload.decode_system(data)
    with suppress(ProtocolError):
        alarm = payload.decode_alarm(data)
        again = payload.decode_alarm(payload.encode_alarm(alarm))
        assert (again.code, again.data, again.kind) == (alarm.code, alarm.data, alarm.kind)
        watch = AlarmWatch("robot", CheckingInlet())
        watch.see(alarm)
        watch.see(payload.Alarm(0))


def seeds() -> Iterable[bytes]:
    """A request and an answer of every kind."""
    contents = [
        payload.encode_status("automatic", "play", "servo_on"),
        payload.encode_position(payload.PULSE, (1, -2, 3, -4, 5, -6)),
        payload.encode_position(payload.BASE, (1, -2, 3, -4, 5, -6, 7, 8)),
        payload.encode_axes((1, -2, 3, -4, 5, -6, 7)),
        payload.encode_axis_names(("S", "L", "U", "R", "B", "T")),
        payload.encode_alarm(payload.Alarm(1020, 3, 1, "2026/01/02 03:04", "異常")),
        payload.encode_system(payload.System("FS100 1.14", "MH5", "P1")),
        b"",
    ]
    for number, data in enumerate(contents):
        yield wire.encode_answer(wire.Answer(number, wire.GET_ALL | wire.ANSWER, 0, 0, data))
    yield wire.encode_answer(wire.Answer(9, wire.GET_ALL | wire.ANSWER, 0x1F, 0xE444))
    yield wire.encode_request(wire.Request(wire.POSITION, 1), 7)


TARGET = Target(run, seeds, 600)
