"""Quiet times by the clock of a zone, across midnight, weekends and summer time."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from cellwatt.outlets.notify.quiet import QuietSettings, passing


def quiet(**values: Any) -> QuietSettings:
    return QuietSettings.model_validate(values)


def at(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


@pytest.mark.parametrize(
    ("when", "held"),
    [
        ("2026-11-24 20:59", False),
        ("2026-11-24 21:00", True),  # 22:00 in Berlin in winter
        ("2026-11-25 04:59", True),
        ("2026-07-24 20:00", True),  # in summer
    ],
)
def test_a_night_by_the_clock_of_its_zone(when: str, held: bool) -> None:
    night = quiet(**{"from": "22:00", "to": "06:00", "zone": "Europe/Berlin"})
    assert passing([night], at(when), "Asia/Tokyo") == (2 if held else 0)


def test_days_are_those_on_which_it_begins() -> None:
    night = quiet(**{"from": "22:00", "to": "06:00", "days": ["fri"]})
    held = [passing([night], at(when), "UTC") for when in ("2026-11-27 05:00", "2026-11-27 23:00", "2026-11-28 05:00")]
    assert held == [0, 2, 2]  # the 27th is a Friday


@given(st.integers(0, 1439), st.integers(0, 1439), st.datetimes(datetime(2026, 1, 1), datetime(2026, 12, 30)))
def test_holds_exactly_within_its_minutes(first: int, last: int, when: datetime) -> None:
    if first == last:
        return
    made = quiet(**{"from": f"{first // 60:02}:{first % 60:02}", "to": f"{last // 60:02}:{last % 60:02}"})
    length = (last - first) % 1440
    minute = when.hour * 60 + when.minute
    assert made.holds(when.replace(tzinfo=UTC)) == ((minute - first) % 1440 < length)


@pytest.mark.parametrize(
    "values",
    [{"from": "25:00"}, {"from": "22:00", "to": "22:00"}, {"zone": "../etc/passwd"}, {"days": ["monday"]}],
)
def test_refuses_what_is_no_time(values: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        quiet(**values)
