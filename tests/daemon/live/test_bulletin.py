"""The lines of a log."""

import json

from cellwatt.live.bulletin import EVERY, Bulletin, line_of, message_of
from tests.daemon.live.cells import alarm, energy, gap, health, interval, source, task


def said(bulletin, *messages):
    return [line.split(" ", 1)[1] for message in messages for line in bulletin.of(message)]


def test_changes_are_told_once_and_health_of_another_version_ends_nothing() -> None:
    bulletin, other = Bulletin(), health()
    del other.content.status["results"]
    assert said(bulletin, other, health(), health()) == ["source arm: ok", "source board: ok"]
    down = {"arm": source("retrying", "nobody answers"), "board": source()}
    assert said(bulletin, health(sources=down, warnings=["the disk is full"])) == [
        "source arm: ok, now retrying: nobody answers",
        "warning: the disk is full",
    ]


def test_results_are_told_with_their_time() -> None:
    bulletin = Bulletin()
    intervals = (interval(1, (1, 3), 2.3), interval(2, (), 0.25), interval(3, (2,), 1.0, closed=False))
    assert said(bulletin, *intervals, task(4), energy(4)) == [
        "interval 1: joints 1+3 moved, 2.30 s",
        "interval 2: rest, 0.25 s",
        "task task_1 × 4 (speed=1.00), 9.00 s",
        "energy task_1 × 4: 65 J ± 0.5 J",
    ]
    (line,) = bulletin.of(task(5))
    assert line.startswith("2023-11-14T22:13:29.000Z ")


def test_lines_of_watch_json_tell_the_same() -> None:
    messages = (health(), interval(1, (2,), 1.0), task(4), energy(4), alarm("a"), gap(30), alarm("a", active=False))
    lines = [json.loads(json.dumps(line_of(message))) for message in messages]
    assert said(Bulletin(), *map(message_of, lines)) == said(Bulletin(), *messages)


def test_an_alarm_is_told_when_it_is_raised_changed_and_cleared() -> None:
    bulletin = Bulletin()
    assert said(bulletin, alarm("a")) == ["error: a is wrong."]
    assert said(bulletin, alarm("a", statement="a is wrong by 13 W.")) == []
    assert said(bulletin, alarm("a", joint=2)) == ["error: a is wrong."]
    assert said(bulletin, alarm("a", active=False, statement="a is well.")) == ["cleared: a is well."]


def test_losses_and_a_new_daemon_are_told() -> None:
    bulletin = Bulletin()
    said(bulletin, health())
    assert said(bulletin, gap(30)) == ["30 of raw/arm/main are lost: no longer kept"]
    assert said(bulletin, health(session=2))[0] == "the daemon was restarted"


def test_it_says_now_and_then_how_the_cell_stands() -> None:
    bulletin = Bulletin()
    assert not list(bulletin.stands(0.0))
    said(bulletin, health(sources={"arm": source(lost=2), "board": source("retrying", "gone")}), alarm("a"))
    now = bulletin.cell.heard
    (line,) = bulletin.stands(now)
    assert line.endswith("plant-1/weld-3 is red: 1 of 2 sources ok, 1998 samples received, 2 lost, 1 alarm")
    assert not list(bulletin.stands(now + EVERY / 2 - 1))


def test_silence_is_told_once_and_its_end() -> None:
    bulletin = Bulletin()
    said(bulletin, health())
    (line,) = bulletin.stands(bulletin.cell.heard + 6.0)
    assert "no message for 6 s; last at 20" in line
    assert not list(bulletin.stands(bulletin.cell.heard + 7.0))
    assert said(bulletin, health()) == ["receiving messages again"]
