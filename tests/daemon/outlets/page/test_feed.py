"""What the page knows of a cell, by what the cell tells; curves of the last minute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from cellwatt.alarms import LOST
from cellwatt.live.state import LiveCell
from cellwatt.outlets.apart import wire
from cellwatt.outlets.page import archive, shapes
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.levels.curves import curves
from cellwatt.outlets.page.levels.episodes import alarm_history
from cellwatt.outlets.page.levels.store import Store
from cellwatt.outlets.page.streams import Hub
from cellwatt.results import Event
from cellwatt.subscriber import Gap, Health, Message
from tests.daemon.outlets.page.cell import (
    CELL,
    EPOCH,
    MS,
    PREDICTION,
    SITE,
    frames,
    interval,
    shelved,
    status,
)
from tests.daemon.outlets.page.recorded import recording
from tests.daemon.outlets.zenoh.fake_cell import alarm


@pytest.fixture
def hub() -> Mock:
    return Mock(Hub)


@pytest.fixture
def feed(hub: Mock) -> Feed:
    return Feed(SITE, CELL, hub)


def told_by(hub: Mock) -> list[tuple[str, Any]]:
    """What browsers were told since the last call, but for health."""
    told = [call.args for call in hub.tell.call_args_list if call.args[0] != "health"]
    hub.reset_mock()
    return told


def up(number: int, acknowledged: Any = None) -> dict[str, Any]:
    return {**asdict(alarm(number)), "acknowledged": acknowledged}


def test_an_alarm_that_health_does_not_know_is_over(feed: Feed, hub: Mock) -> None:
    feed.take_item(alarm(1))
    feed.take_item(alarm(2, time=EPOCH + 20_000_000_000))
    told_by(hub)
    feed.take_health(status())
    ((_, told),) = told_by(hub)
    assert (told["id"], told["active"], told["statement"]) == ("alarm-1", False, LOST)
    assert [a["id"] for a in feed.state()["alarms"]] == ["alarm-2"], "it was raised after health was taken"


def test_an_alarm_on_the_shelf_is_not_over(feed: Feed, hub: Mock) -> None:
    feed.take_item(alarm(2))
    told_by(hub)
    feed.take_health(status(shelved=[shelved(2)]))
    assert [kind for kind, _ in told_by(hub)] == ["shelved"]
    assert feed.state()["alarms"] == []
    assert len(feed.live.cleared) == 0
    feed.take_health(status([up(2)]))
    assert [kind for kind, _ in told_by(hub)] == ["alarm", "shelved"]
    assert [a["id"] for a in feed.state()["alarms"]] == ["alarm-2"]


def test_an_acknowledgement_is_told_once_and_ends_with_the_alarm(feed: Feed, hub: Mock) -> None:
    known = {"name": "ada", "note": "seen", "time": EPOCH}
    feed.take_health(status([up(1)]))
    told_by(hub)
    data = {"alarm": "alarm-1", "name": "ada", "note": "seen"}
    feed.take_item(Event(EPOCH, None, "acknowledged", "", data))
    (_, (_, told)) = told_by(hub)
    assert told["acknowledged"] == {"name": "ada", "note": "seen", "time": MS}
    feed.take_health(status([up(1, known)]))
    assert told_by(hub) == [], "health says the same"
    feed.take_item(alarm(1, active=False))
    ((_, told),) = told_by(hub)
    assert (told["active"], told["acknowledged"]) == (False, None)


def test_messages_of_a_subscriber_are_the_same(feed: Feed, hub: Mock) -> None:
    def take(topic: str, content: Any) -> None:
        feed.take(Message(topic, EPOCH, 0, False, content))

    take("health", Health(EPOCH, EPOCH, {}, status()))
    take("frame", frames(0, 3))
    take("prediction/power", PREDICTION)
    take("interval", interval(1))
    take("alarm", alarm(1))
    take("frame", Gap(3, "too late"))
    assert [kind for kind, _ in told_by(hub)] == ["interval", "alarm", "gap"]
    told = feed.state()
    assert told["session"] == MS
    assert [len(told[name]) for name in ("channels", "alarms", "intervals", "predictions")] == [3, 1, 1, 1]
    take("health", Health(EPOCH + 5, EPOCH, {}, status()))
    assert feed.state()["alarms"] == [], "a daemon that was started again"
    assert hub.end.call_count == 1


# curves of the last minute ------------------------------------------------------------------------


def lively(count: int) -> LiveCell:
    live = LiveCell()
    live.add_frames(frames(0, count))
    live.add(PREDICTION)
    return live


NAMES = ("arm.joint_1.position", "arm.supply.power", "prediction/power/power", "nonsense")


def drawn(live: LiveCell, names: Sequence[str], start: float, end: float, points: int, folder: Any = None) -> Any:
    """Curves of a record, with what is in memory."""
    return curves(Store(folder, CELL), names, start, end, points, archive.in_memory(live, names))


def test_curves_at_the_step_of_the_frames_have_one_value() -> None:
    got = drawn(lively(20), NAMES, MS + 40, MS + 200, 1000)
    assert (got["step_ms"], got["from_record"]) == (20.0, False)
    assert got["t"] == [MS + 20 * n for n in range(2, 10)]
    assert got["v"]["arm.supply.power"] == {"min": [*(100.0 + n for n in range(2, 9)), None]}
    assert got["v"]["nonsense"] == {"min": [None] * 8}
    assert drawn(lively(20), NAMES, MS, MS + 40, 10)["v"]["prediction/power/power"] == {"min": [101.0, None]}


def test_intervals_and_alarms_are_told_once(tmp_path: Path) -> None:
    live = lively(5)
    live.add(interval(1))
    live.add(alarm(1))
    live.add(alarm(1, active=False, time=EPOCH + 500_000_000))
    live.add(alarm(2))
    up = alarm(1, time=EPOCH + 1_000_000)
    recording(tmp_path, [[interval(1), up]], session=EPOCH, cell=CELL)
    got = drawn(live, (), MS, MS + 2000, 10, tmp_path)
    assert len(got["intervals"]) == 1
    assert {(a["id"], a["cleared"]) for a in got["alarms"]} == {("alarm-1", MS + 500), ("alarm-2", None)}
    assert drawn(live, (), MS + 600, MS + 700, 10)["alarms"] == got["alarms"][1:]


def test_alarms_in_memory_are_a_short_history() -> None:
    live = lively(5)
    live.add(alarm(1))
    live.add(alarm(1, active=False, time=EPOCH + 500_000_000, statement="Resolved."))
    live.add(alarm(2))
    held, nowhere = archive.in_memory(live), Store(None, CELL)
    got = alarm_history(nowhere, MS, MS + 2000, 10, held)
    assert [(a["id"], a["cleared"], a["cleared_statement"]) for a in got["alarms"]] == [
        ("alarm-2", None, None),
        ("alarm-1", MS + 500, "Resolved."),
    ]
    assert got["complete"] is True
    assert [a["id"] for a in alarm_history(nowhere, MS + 600, MS + 700, 10, held)["alarms"]] == ["alarm-2"]


# forms --------------------------------------------------------------------------------------------


def test_continuous_values_are_rounded_and_no_others() -> None:
    exact = np.array([1234567.891, -0.000123456789, 0.0, np.nan, np.inf, 5e-320])
    got = shapes.significant(exact)
    assert got[:3].tolist() == [1234568.0, -0.0001234568, 0.0]
    assert np.isnan(got[3])
    assert got[4] == np.inf
    told = shapes.frames([frames(1, 1)], ("arm.joint_1.position", "arm.mode"))
    assert told["v"] == {"arm.joint_1.position": [0.3333333], "arm.mode": [4000000001.0]}


@pytest.mark.parametrize("data", [b"\x63\x00\x00\x00\x01x", b"\x03\xff\xff\xff\xff"])
async def test_nonsense_on_the_wire_is_an_error(data: bytes) -> None:
    import asyncio

    from cellwatt import ProtocolError

    reader = asyncio.StreamReader()
    reader.feed_data(data)
    with pytest.raises(ProtocolError):
        await wire.receive(reader)
