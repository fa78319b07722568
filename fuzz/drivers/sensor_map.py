"""A CAN sensor's map with its DBC file."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.resources import files

from cellwatt.errors import ConfigError
from cellwatt_drivers import can_sensor
from cellwatt_drivers.can_sensor.intake import Intake
from cellwatt_drivers.can_sensor.sensor_map import load_decodings
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target, folder

BETWEEN = b"\n%%%%\n"
"""Between the map and the DBC file."""


def run(data: bytes) -> None:
    """As the two files; where they are good, frames of zeros and ones are decoded."""
    from can import Message

    text, _, database = data.partition(BETWEEN)
    path = folder() / "sensor.yaml"
    path.write_bytes(text)
    (folder() / "sensor.dbc").write_bytes(database)
    try:
        _, decodings = load_decodings(None, path)
    except ConfigError as error:
        assert error.problems
        return
    for decoding in decodings.values():
        inlet = CheckingInlet()
        intake = Intake("sensor", decoding, decoding.wanted.cycle, inlet)
        for i, body in enumerate((bytes(8), b"\xff" * 8, b"\1\0" * 4, b"")):
            intake.take(Message(arbitration_id=1, data=body, timestamp=1e9 + i), inlet.now())
        intake.flush(inlet.now())


def seeds() -> Iterable[bytes]:
    """A small map with a counter, flags and a signal in another unit; one with a multiplexer."""
    packaged = (files(can_sensor) / "sensors" / "ivt_s.dbc").read_bytes()
    dbc = (
        b'VERSION ""\nNS_ :\nBS_:\nBU_: Vector__XXX\nBO_ 1313 A: 6 Vector__XXX\n'
        b' SG_ C : 8|4@1+ (1,0) [0|15] "" Vector__XXX\n SG_ F : 12|1@1+ (1,0) [0|1] "" Vector__XXX\n'
        b' SG_ I : 23|32@0- (1,0) [0|0] "mA" Vector__XXX\n'
        b'BO_ 2147484961 B: 8 Vector__XXX\n SG_ M M : 0|8@1+ (1,0) [0|0] "" Vector__XXX\n'
        b' SG_ U m1 : 8|16@1+ (0.1,0) [0|0] "V" Vector__XXX\n SG_ W m0 : 8|16@1+ (1,0) [0|0] "W" Vector__XXX\n'
    )
    head = b"maker: M\nmodel: N\ndbc: sensor.dbc\nstreams:\n"
    first = b"  a: {message: A, cycle: 20 ms, counter: C, flags: {F: clipped}, signals: {I: bus.current}}\n"
    yield head + first + BETWEEN + dbc
    second = b"  b: {message: B, signals: {U: {channel: bus.voltage, unit: V}}}\n"
    yield head + second + BETWEEN + dbc
    yield head + b"  a: {message: IVT_I, signals: {I: bus.current}}\n" + BETWEEN + packaged[:1500]


TARGET = Target(run, seeds, 3000)
