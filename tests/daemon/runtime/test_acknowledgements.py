"""Alarms that people acknowledge and shelve: told, recorded, and not forgotten with the process."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellwatt import Alarm, CellwattError, Event
from cellwatt.alarms import AlarmBook, Damping
from cellwatt.runtime.acknowledgements import FILE, LONGEST_SHELF, Acknowledgements
from tests.daemon.runtime.fakes import alarm
from tests.daemon.runtime.test_teller import SECOND, Told


def test_an_acknowledged_alarm_says_by_whom_and_the_record_has_it() -> None:
    teller = Told()
    teller.take(alarm("a"))
    teller.time = 7
    teller.acknowledge("a", " Ines  Lopez ", "gear is ordered\n")
    teller.looked_at()
    known = teller.status()["alarms"][0]["acknowledged"]
    assert known == {"name": "Ines Lopez", "note": "gear is ordered", "time": 7}
    (event,) = [item for item in teller.recorded if isinstance(item, Event)]
    assert (event.kind, event.time) == ("acknowledged", 7)
    assert event.text == "Ines Lopez acknowledged a: gear is ordered"
    assert event.data == {"alarm": "a", "name": "Ines Lopez", "note": "gear is ordered"}
    assert event in teller.offered


def test_a_shelved_alarm_stands_apart_until_it_is_taken_off() -> None:
    teller = Told()
    teller.take(alarm("a"))
    teller.shelve("a", 100, "Ines", "known")
    assert teller.looked_at() == []
    assert [(s["id"], s["shelf"]["until"]) for s in teller.status()["shelved"]] == [("a", 100)]
    teller.take(replace(alarm("a", active=False), time=20))
    teller.time = 30
    teller.unshelve("a", "Omar")
    kinds = [item.kind if isinstance(item, Event) else item.active for item in teller.offered]
    assert kinds == [True, "shelved", "unshelved", False]
    assert teller.looked_at() == [] and teller.status()["shelved"] == []


@pytest.mark.parametrize(
    ("order", "told"),
    [
        (lambda t: t.acknowledge("b", "Ines", ""), "no alarm 'b' is active"),
        (lambda t: t.acknowledge("a", "  ", ""), "enter your name"),
        (lambda t: t.acknowledge("a", "x" * 101, ""), "at most 100 characters"),
        (lambda t: t.acknowledge("a", "Ines", "x" * 2001), "at most 2000 characters"),
        (lambda t: t.shelve("a", 5, "Ines", ""), "up to 31 days"),
        (lambda t: t.shelve("a", 6 + LONGEST_SHELF, "Ines", ""), "up to 31 days"),
        (lambda t: t.unshelve("a", "Ines"), "is not shelved"),
    ],
)
def test_what_cannot_be_done_is_refused_and_not_told(order: Callable[[Any], None], told: str) -> None:
    teller = Told()
    teller.take(alarm("a"))
    teller.time = 5
    with pytest.raises(CellwattError, match=told):
        order(teller)
    assert [type(item) for item in teller.offered] == [Alarm]


# the file --------------------------------------------------------------------------------------------


class Desk:
    """An alarm book with the words about it, of a session at a time."""

    def __init__(self, session: int, now: int) -> None:
        self.book = AlarmBook(Damping())
        self.said: list[Any] = []
        self.words = Acknowledgements(self.book, session, lambda: now, self.said.append, self.said.extend)


async def kept(folder: Path, session: int = 1) -> Desk:
    """A desk whose words are on disk: alarm a is acknowledged, b on the shelf, of which c knows nothing."""
    desk = Desk(session, now=SECOND)
    for name in "abc":
        desk.book.take(alarm(name))
    desk.words.acknowledge("a", "Ines", "")
    desk.words.shelve("b", 3600 * SECOND, "Ines", "")
    assert await desk.words.keep(folder) is None
    return desk


async def test_the_next_daemon_goes_on_with_what_people_said(tmp_path: Path) -> None:
    await kept(tmp_path)
    later = Desk(2, now=60 * SECOND)
    later.words.read(tmp_path)
    assert later.book.take(replace(alarm("a"), time=70 * SECOND)) != []
    assert later.book["a"].acknowledgement is not None
    assert later.book.take(replace(alarm("b"), time=70 * SECOND)) == []


async def test_a_clear_that_nobody_heard_is_known_to_the_next_process_of_the_session(tmp_path: Path) -> None:
    desk = await kept(tmp_path)
    assert desk.book.take(replace(alarm("b", active=False), time=2 * SECOND)) == []
    assert await desk.words.keep(tmp_path) is None
    again = Desk(1, now=3 * SECOND)
    again.book.take(alarm("b"))  # by the journal it is up
    again.words.read(tmp_path)
    assert "b" not in again.book


async def test_words_are_written_when_they_change_and_gone_when_the_alarm_is_over(tmp_path: Path) -> None:
    desk = await kept(tmp_path)
    before = (tmp_path / FILE).stat().st_mtime_ns
    assert await desk.words.keep(tmp_path) is None
    assert (tmp_path / FILE).stat().st_mtime_ns == before
    desk.book.take(replace(alarm("a", active=False), time=2 * SECOND))
    await desk.words.keep(tmp_path)
    assert [s["alarm"]["id"] for s in json.loads((tmp_path / FILE).read_text())["alarms"]] == ["b"]


@pytest.mark.parametrize("text", ["", "{", '{"session": 1, "alarms": [3]}', '{"session": 2, "alarms": [{"alarm": 1}]}'])
def test_a_file_that_is_damaged_is_told_and_stops_nobody(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, text: str
) -> None:
    (tmp_path / FILE).write_text(text)
    desk = Desk(1, now=0)
    desk.words.read(tmp_path)
    (record,) = caplog.records
    assert "alarms.json cannot be read" in record.getMessage()


async def test_a_folder_that_takes_nothing_is_told(tmp_path: Path) -> None:
    desk = Desk(1, now=SECOND)
    desk.book.take(alarm("a"))
    desk.words.acknowledge("a", "Ines", "")
    problem = await desk.words.keep(tmp_path / "missing")
    assert problem is not None and problem.endswith("alarms.json cannot be written: No such file or directory")
