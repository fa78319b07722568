"""A cell for the tests of notifications: its alarms, a view of it, and an outlet that runs beside a test."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from cellwatt import Alarm
from cellwatt.outlets.notify.outlet import NotifyOutlet
from cellwatt.outlets.notify.settings import NotifySettings
from cellwatt.outlets.notify.texts import About
from cellwatt.results import Event
from tests.daemon.outlets.zenoh import fake_cell
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, Journal
from tests.doing import doing
from tests.patience import eventually

SECOND = 10**9
ABOUT = About(SITE, CELL)


def alarm(number: int, active: bool = True, **more: Any) -> Alarm:
    about = {
        "id": f"faults.arm.joint_fault.{number}",
        "time": EPOCH + number + (0 if active else SECOND),
        "statement": f"Joint {number} is loaded 12 Nm more than it should be",
        "evidence": {"residual_Nm": 12.04},
    }
    return fake_cell.alarm(number, active, **{**about, **more})


def event(kind: str, alarm_id: str) -> Event:
    return Event(EPOCH, "arm", kind, f"Ada {kind} {alarm_id}", {"alarm": alarm_id, "name": "Ada", "note": ""})


class View(FakeView):
    """A cell in whose folder the outlet may write, and its journal."""

    def __init__(self, folder: Path, session: int = EPOCH, journal: Journal | None = None, record: bool = True) -> None:
        super().__init__(session)
        self.folder, self.journal = folder, journal
        self.record_folder = folder if record else None


def outlet(view: View, to: Mapping[str, Any], **more: Any) -> NotifyOutlet:
    """An outlet that groups nothing and tries again soon, unless told otherwise."""
    recipients = {name: {"group": 0.0, "severity": "info", **settings} for name, settings in to.items()}
    values = {"retry": 0.02, "timeout": 20.0, "zone": "UTC", **more, "to": recipients}
    return NotifyOutlet("notify", NotifySettings.model_validate(values), view)


async def offered(made: NotifyOutlet, one: Alarm, counter: str, count: int = 1) -> None:
    """Offer an alarm and wait until one of the outlet's counters has come to ``count``."""
    made.offer(one)
    await eventually(lambda: made.account.counters[counter] >= count, f"{counter}: {count}")


@asynccontextmanager
async def running(
    view: View, to: Mapping[str, Any], before: NotifyOutlet | None = None, **more: Any
) -> AsyncIterator[NotifyOutlet]:
    """An outlet that runs, and that succeeds the one before it."""
    made = outlet(view, to, **more)
    if before is not None:
        made.succeed(before)
    async with doing(made.run()):
        yield made
