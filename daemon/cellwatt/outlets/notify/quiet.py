"""Quiet times: spans of the day, by a wall clock, in which only grave alarms pass. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import datetime, timedelta, tzinfo
from typing import Annotated, Final, Literal
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, Field, field_validator, model_validator

from cellwatt.alarms import SEVERITIES
from cellwatt.outlet import Section
from cellwatt.results import Severity

Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
DAYS: Final[tuple[Day, ...]] = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_CLOCK: Final = re.compile(r"([01]\d|2[0-3]):([0-5]\d)|24:00")
_DAY: Final = 1440  # minutes


def _zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (OSError, ValueError, ZoneInfoNotFoundError) as error:
        raise ValueError(f"no time zone {name!r} is known here; expected a name like Europe/Berlin") from error
    return name


Zone = Annotated[str, AfterValidator(_zone)]
"""Name of a time zone that this PC knows."""


def zone_of(name: str | None) -> tzinfo | None:
    """Time zone of that name; ``None``, the zone of this PC, for none."""
    return None if name is None else ZoneInfo(name)


class QuietSettings(Section):
    """One quiet time of a recipient."""

    begin: str = Field(default="00:00", alias="from")
    """Time of day at which it begins, like ``"22:00"``."""
    end: str = Field(default="24:00", alias="to")
    """Time of day at which it ends; one that is earlier than ``from`` is of the next day."""
    days: tuple[Day, ...] = DAYS
    """Days on which it begins: mon, tue, wed, thu, fri, sat, sun."""
    zone: Zone | None = None
    """Time zone of these times, like Europe/Berlin; where absent the ``zone`` of ``notify``."""
    unless: Severity = "error"
    """Least severity that passes all the same."""

    @field_validator("begin", "end")
    @classmethod
    def _time(cls, text: str) -> str:
        if not _CLOCK.fullmatch(text):
            raise ValueError(f"found {text!r:.60}, expected a time of day in quotes, like '22:00'")
        return text

    @model_validator(mode="after")
    def _span(self) -> QuietSettings:
        if self.begin == self.end or self.begin == "24:00":
            raise ValueError("a quiet time ends at another time than it begins; a whole day is 00:00 to 24:00")
        return self

    def holds(self, at: datetime) -> bool:
        """True if ``at``, a time with a zone, is within this quiet time by that zone's clock."""
        minute, first, last = at.hour * 60 + at.minute, _minutes(self.begin), _minutes(self.end)
        if first < last:
            return first <= minute < last and DAYS[at.weekday()] in self.days
        if minute >= first:
            return DAYS[at.weekday()] in self.days
        return minute < last and DAYS[(at - timedelta(days=1)).weekday()] in self.days


def passing(times: Iterable[QuietSettings], at: datetime, zone: str | None) -> int:
    """Rank of the least severity that passes at ``at``: 0 if no time is quiet. ``zone`` is for times without one."""
    held = (quiet for quiet in times if quiet.holds(at.astimezone(zone_of(quiet.zone or zone))))
    return max((SEVERITIES.index(quiet.unless) for quiet in held), default=0)


def _minutes(clock: str) -> int:
    hours, _, minutes = clock.partition(":")
    return int(hours) * 60 + int(minutes)
