"""What outlets said is found in each other, and what differs is told."""

from __future__ import annotations

import json

import pytest

from cellwatt.demo.outlets.said import CURRENT, POWER, Compared, Said, Told, differing, newest_of_all


def frame(power: float, current: float | None = None) -> Told:
    values = {POWER: power} if current is None else {POWER: power, CURRENT: current}
    return Told(power, values)


def test_the_newest_that_all_tell_is_found_however_late_one_is() -> None:
    scraped = [frame(3.0), frame(7.0)]
    live = [frame(float(n), 0.1 * n) for n in range(10)]
    behind = live[:7]
    assert newest_of_all([scraped, live]) == [scraped[1], live[7]]
    assert newest_of_all([scraped, live, behind]) == [scraped[0], live[3], live[3]]
    assert newest_of_all([scraped, [frame(3.1)]]) is None
    assert newest_of_all([scraped, []]) is None
    assert newest_of_all([]) is None


def test_only_what_several_tell_can_differ() -> None:
    assert differing([frame(1.0), frame(1.0, 2.0), frame(1.0, 2.0)]) == []
    assert differing([frame(1.0), frame(1.0, 2.0), frame(1.0, 2.5)]) == [CURRENT]


def test_each_frame_is_compared_once() -> None:
    one, other, compared = Said("one"), Said("other"), Compared()
    compared.look([one, other])
    for said in (one, other):
        said.frame({POWER: 5.0, CURRENT: 1.0}, 20_000_000)
        said.state("green", 100, 0)
    for _ in range(3):
        compared.look([one, other])
    assert (compared.frames, compared.states, compared.unlike) == (1, 1, {})
    one.frame({POWER: 6.0, CURRENT: 1.0})
    other.frame({POWER: 6.0, CURRENT: 1.5})
    one.state("amber", 600, 2)
    other.state("red", 600, 1)
    for _ in range(3):
        compared.look([one, other])
    assert (compared.frames, compared.states) == (1, 1)
    assert compared.unlike == {CURRENT: 1, "state": 1, "alarms that are up": 1}


def test_health_is_read_once_the_arm_is_in_it() -> None:
    said = Said("MQTT")
    said.health("{}")
    assert not said.states
    status = {"state": "amber", "sources": {"arm": {"received": 501}}, "alarms": [{}, {}]}
    said.health(json.dumps(status).encode())
    said.health(json.dumps(status))
    assert [told.values for told in said.states] == [{"state": "amber", "samples of arm": 501, "alarms that are up": 2}]


def test_the_first_time_of_an_alarm_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    said = Said("MQTT")
    said.alarm("")
    assert said.heard is None
    for at, words in ((10.0, "up"), (11.0, ""), (12.0, "up again")):
        monkeypatch.setattr("time.time", lambda at=at: at)
        said.alarm(words)
    assert (said.fault, said.heard) == ("up again", 10.0)
    said.alarm("")
    assert (said.fault, said.words) == ("", "up again")
