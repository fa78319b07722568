from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.driver import Identity
from cellwatt.errors import ProtocolError
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
    assert parse_values(f"{WORKED}, ", 6) == values, "some analyzers end a list with a separator"


@pytest.mark.parametrize(
    "text", ["9.9E+37", "-9.9E37", "9.9e36", "-INF", "1.#INF00", "1e999", "--OL--", "-OF-", "OVLD"]
)
def test_overload(text):
    value = parse_value(text)
    assert math.isnan(value.number)
    assert value.overload


@pytest.mark.parametrize("text", ["9.91E+37", "9.910000E+37", "NAN", "-nan", "1.#QNAN", "---", "----"])
def test_nothing_measured(text):
    value = parse_value(text)
    assert math.isnan(value.number)
    assert not value.overload


@pytest.mark.parametrize("text", ["", "1_000", "2.3V", "1,2", "infinite", "٣", "1e"])
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
        ("0", (0, "")),
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
    found = parse_identification("Rohde&Schwarz,HMC8015,045367612,HW42000000,SW1.403", "Rohde & Schwarz")
    assert found == Identity("Rohde & Schwarz", "HMC8015", "045367612", "SW1.403")


@pytest.mark.parametrize("data", [b"\x00", b"1.0\x1b", b"\xff\xfe", "µ".encode()])
def test_bytes_that_are_no_text_are_refused(data):
    with pytest.raises(ProtocolError, match="not a line of text"):
        decode_line(data)


@given(st.lists(st.floats(-9e36, 9e36), min_size=1, max_size=10))
def test_numbers_in_any_form_come_back(numbers):
    for form in ("{!r}", "{:.17E}", "{:+.17e}"):
        values = parse_values(",".join(form.format(x) for x in numbers), len(numbers))
        assert [v.number for v in values] == numbers
