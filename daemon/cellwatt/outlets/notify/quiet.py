"""Quiet times: spans of the day, by a wall clock, in which only severe alarms are sent. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import datetime, timedelta, tzinfo
from typing import Annotated, Final, Literal
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, Field, model_validator

from cellwatt.alarms import SEVERITIES
from cellwatt.results import Severity
from cellwatt.section import Section

Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
DAYS: Final[tuple[Day, ...]] = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_CLOCK: Final = re.compile(r"([01]\d|2[0-3]):([0-5]\d)|24:00")
_DAY: Final = 1440  # minutes


def _zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (OSError, ValueError, ZoneInfoNotFoundError) as error:
        raise ValueError(f"the time zone {name!r} is unknown on this PC; expected a name like Europe/Berlin") from error
    return name


Zone = Annotated[str, AfterValidator(_zone)]
"""Name of a time zone in this PC's time zone database."""


def zone_of(name: str | None) -> tzinfo | None:
    """Time zone of that name; without a name ``None``, which stands for the zone of this PC."""
    return None if name is None else ZoneInfo(name)


def _clock(text: str) -> str:
    if not _CLOCK.fullmatch(text):
        raise ValueError("expected a time of day in quotes, like '22:00'")
    return text


_Clock = Annotated[str, AfterValidator(_clock)]


class QuietSettings(Section):
    """One quiet time of a recipient."""

    begin: _Clock = Field(default="00:00", alias="from")
    """Time of day at which it begins, like ``"22:00"``."""
    end: _Clock = Field(default="24:00", alias="to")
    """Time of day at which it ends; a time earlier than ``from`` is on the next day."""
    days: tuple[Day, ...] = DAYS
    """Days of the week on which it begins: mon, tue, wed, thu, fri, sat, sun."""
    zone: Zone | None = None
    """Time zone of these times, like Europe/Berlin; default: the ``zone`` of ``notify``."""
    unless: Severity = "error"
    """Least severity that is sent during the quiet time."""

    @model_validator(mode="after")
    def _span(self) -> QuietSettings:
        if self.begin == self.end or self.begin == "24:00":
            raise ValueError("begin and end of a quiet time must differ; a whole day is 00:00 to 24:00")
        return self

    def holds(self, at: datetime) -> bool:
        """True if ``at``, a time with a zone, is within this quiet time by the clock of that zone."""
        minute, first, last = at.hour * 60 + at.minute, _minutes(self.begin), _minutes(self.end)
        if first < last:
            return first <= minute < last and DAYS[at.weekday()] in self.days
        if minute >= first:
            return DAYS[at.weekday()] in self.days
        return minute < last and DAYS[(at - timedelta(days=1)).weekday()] in self.days


def passing(times: Iterable[QuietSettings], at: datetime, zone: str | None) -> int:
    """Rank of the least severity sent at ``at``: 0 outside quiet times. ``zone`` applies to quiet times without one."""
    held = (quiet for quiet in times if quiet.holds(at.astimezone(zone_of(quiet.zone or zone))))
    return max((SEVERITIES.index(quiet.unless) for quiet in held), default=0)


def _minutes(clock: str) -> int:
    hours, _, minutes = clock.partition(":")
    return int(hours) * 60 + int(minutes)
