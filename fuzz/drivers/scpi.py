"""An analyzer's lines of text."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from cellwatt.errors import ProtocolError
from cellwatt_drivers.scpi_analyzer import wire
from cellwatt_drivers.scpi_analyzer.dialect import DIALECTS
from fuzz.target import Target


def run(data: bytes) -> None:
    """Each line as every kind of answer."""
    for line in data.split(b"\n"):
        with suppress(ProtocolError):
            _line(wire.decode_line(line))


def _line(text: str) -> None:
    for count, separator in ((1, ","), (2, ","), (3, ";")):
        with suppress(ProtocolError):
            values = wire.parse_values(text, count, separator)
            assert len(values) == count
            assert not any(value.overload and value.number == value.number for value in values)
    with suppress(ProtocolError):
        code, words = wire.parse_error(text)
        assert wire.parse_error(f'{code},"{words}"') == (code, words)
    with suppress(ProtocolError):
        assert 0 <= wire.parse_count(text) <= 255
    wire.parse_identification(text, "")
    for dialect in DIALECTS.values():
        assert isinstance(dialect.found(text), str)
        dialect.short(text)


def seeds() -> Iterable[bytes]:
    """Lines as analyzers send them."""
    yield b"2.30512E+02,1.0412E+00,2.3988E+02\r\n"
    yield b"NAN,---,9.91E37,INF\n230;1.5;-3\n"
    yield b'-113,"Undefined header"\n0,"No error"\n'
    yield b"ROHDE&SCHWARZ,HMC8015,12345,1.403\n:NUMERIC:NORMAL:NUMBER 9\n"
    yield b"URMS,IRMS,P\n:NUM:NORM:ITEM1 U,1\nYOKOGAWA,WT333,91N,F1.04\n"


TARGET = Target(run, seeds, 5000)
