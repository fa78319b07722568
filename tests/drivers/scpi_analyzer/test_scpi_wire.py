from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.errors import ProtocolError
from cellwatt_drivers.scpi_analyzer.dialect import HMC8015
from cellwatt_drivers.scpi_analyzer.wire import (
    decode_line,
    parse_error,
    parse_identification,
    parse_value,
    parse_values,
)

WORKED = "2.3012E+02,1.0500E+01,2.4100E+03,2.4162E+03,9.9743E-01,4.9998E+01"


def test_the_worked_exchange():
    values = parse_values(WORKED, 6)
    assert [v.number for v in values] == [230.12, 10.5, 2410.0, 2416.2, 0.99743, 49.998]
    assert not any(v.overload for v in values)


@pytest.mark.parametrize("text", ["9.9E+37", "9.90000000E+37", "-9.9E37", "9.9e36", "1E+38", "INF", "-INF", "1e999"])
def test_overload(text):
    value = parse_value(text)
    assert math.isnan(value.number)
    assert value.overload


@pytest.mark.parametrize("text", ["9.91E+37", "9.910000E+37", "NAN", "nan", "---", "----"])
def test_nothing_measured(text):
    value = parse_value(text)
    assert math.isnan(value.number)
    assert not value.overload


@pytest.mark.parametrize("text", ["9.8E+36", "-1", "+.5e-3", "3.", " 7 "])
def test_numbers(text):
    assert parse_value(text).number == float(text)


@pytest.mark.parametrize("text", ["", "1_000", "0x10", "2.3V", "1,2", "1 2", "infinite", "٣", "1e", "--1", "nano"])
def test_anything_else_is_refused(text):
    with pytest.raises(ProtocolError, match="not a measured value"):
        parse_value(text)


@pytest.mark.parametrize("count", [1, 5, 7])
def test_a_shifted_or_cut_answer_is_refused(count):
    with pytest.raises(ProtocolError, match=f"6 values .* expected {count}"):
        parse_values(WORKED, count)


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ('0,"No error"', (0, "No error")),
        ('+0,"No error"', (0, "No error")),
        ('-113,"Undefined header"', (-113, "Undefined header")),
        ("-222, Data out of range", (-222, "Data out of range")),
        ('-350,"Queue overflow"\r', (-350, "Queue overflow")),
    ],
)
def test_error_queue_entries(line, found):
    assert parse_error(line) == found


@pytest.mark.parametrize("line", ["", "No error", "2.3012E+02,1.05E+01", '-113 "Undefined header"'])
def test_other_answers_are_no_errors(line):
    with pytest.raises(ProtocolError, match="not an entry of the error queue"):
        parse_error(line)


def test_identification():
    found = parse_identification("Rohde&Schwarz,HMC8015,045367612,HW42000000,SW1.403")
    assert (found.maker, found.model) == ("Rohde&Schwarz", "HMC8015")
    assert (found.serial, found.firmware) == ("045367612", "SW1.403")


@pytest.mark.parametrize("line", ["HMC8015", "Rohde&Schwarz,HMC8015", "HAMEG,HMC8015,1"])
def test_short_identifications_leave_fields_empty(line):
    assert parse_identification(line).firmware == ""


@pytest.mark.parametrize(
    ("mnemonic", "channel", "unit", "kind", "scale"),
    [
        ("URMS", "supply.voltage", "V", "continuous", 1.0),
        ("IRMS", "supply.current", "A", "continuous", 1.0),
        ("P", "supply.power", "W", "continuous", 1.0),
        ("S", "supply.apparent_power", "VA", "continuous", 1.0),
        ("Q", "supply.reactive_power", "var", "continuous", 1.0),
        ("LAMB", "supply.power_factor", "1", "continuous", 1.0),
        ("PHI", "supply.phase", "rad", "continuous", math.pi / 180),
        ("FU", "supply.frequency", "Hz", "continuous", 1.0),
        ("WH", "supply.energy", "J", "counter", 3600.0),
    ],
)
def test_functions_of_the_hmc8015(mnemonic, channel, unit, kind, scale):
    function = HMC8015.functions[mnemonic]
    assert (function.channel.name, function.channel.unit, function.channel.kind) == (channel, unit, kind)
    assert function.scale == pytest.approx(scale)


@pytest.mark.parametrize(
    ("name", "short"), [("LAMB", "LAMB"), ("Lambda", "LAMB"), (" urms ", "URMS"), ("FPLL", "FPLL")]
)
def test_spellings(name, short):
    assert HMC8015.short(name) == short


def test_lines_end_in_lf_or_cr_lf():
    assert decode_line(b"1.0\r\n") == decode_line(b"1.0\n") == decode_line(b"1.0") == "1.0"


@pytest.mark.parametrize("data", [b"\x00", b"1.0\x1b", b"\xff\xfe", "µ".encode()])
def test_bytes_that_are_no_text_are_refused(data):
    with pytest.raises(ProtocolError, match="not a line of text"):
        decode_line(data)


@given(st.lists(st.floats(-9e36, 9e36), min_size=1, max_size=10))
def test_numbers_in_any_form_come_back(numbers):
    for form in ("{!r}", "{:.17E}", "{:+.17e}"):
        values = parse_values(",".join(form.format(x) for x in numbers), len(numbers))
        assert [v.number for v in values] == numbers


def taken_as_written(data: bytes) -> bool:
    """Read one line in full; whatever is accepted must be what Python's own reading of the text gives."""
    try:
        text = decode_line(data)
        values = parse_values(text, 6)
    except ProtocolError:
        return False
    for token, value in zip(text.split(","), values, strict=True):
        if not math.isnan(value.number):
            assert float(token) == value.number
            assert abs(value.number) < 9.9e36
        else:
            assert "N" in token.upper() or set(token.strip()) == {"-"} or abs(float(token)) >= 9.9e36
    return True


@given(st.binary(max_size=80))
def test_any_bytes_are_values_or_a_protocol_error(data):
    taken_as_written(data)
    for parse in (parse_error, lambda line: parse_values(line, 1)):
        try:
            parse(data.decode("latin-1"))
        except ProtocolError:
            continue


def fuzz(count: int) -> tuple[int, int]:
    rng = random.Random(8015)
    seeds = [WORKED.encode(), b"NAN,9.9E+37,9.91E+37,---,-1.5E-03,0\r", b"1.0000E+00," * 5 + b"INF"]
    accepted = 0
    for _ in range(count):
        raw = bytearray(rng.choice(seeds))
        for _ in range(rng.randint(1, 3)):
            match rng.randrange(4):
                case 0 if raw:
                    raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
                case 1 if raw:
                    raw[rng.randrange(len(raw))] = rng.choice(b"0123456789+-.eE,NAN \r")
                case 2:
                    del raw[rng.randrange(len(raw) + 1) :]
                case _:
                    at = rng.randrange(len(raw) + 1)
                    raw[at:at] = rng.choice([b",", b"9", b"E+", b"-", rng.randbytes(2)])
        accepted += taken_as_written(bytes(raw))
    return accepted, count - accepted


def test_mutated_lines():
    accepted, refused = fuzz(20_000)
    assert accepted > 1_000
    assert refused > 1_000
