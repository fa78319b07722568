"""The alarm book: patience, damping, acknowledgement, shelf, and what holds of every course of alarms."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt import Alarm, AlarmBook, CellwattError
from cellwatt.alarms import AT_ONCE, SEVERITIES, Damping, Patience

SECOND = 10**9
DAMPING = Damping(times=2, seconds=30.0)
HOUR = 3600 * SECOND


def hot(time: int = 0, name: str = "hot", **changes: Any) -> Alarm:
    return replace(Alarm(name, "heat", "warning", True, time, time, "The motor is hot."), **changes)


def told(alarms: Sequence[Alarm]) -> list[tuple[bool, int]]:
    return [(a.active, a.time) for a in alarms]


@pytest.fixture
def raised() -> AlarmBook:
    """A book in which the alarm ``hot`` is active since 1 ns."""
    book = AlarmBook()
    book.raise_(hot(1))
    return book


@pytest.fixture
def shelved(raised: AlarmBook) -> AlarmBook:
    raised.shelve("hot", 10, "Ines", "is being repaired", 2)
    return raised


# patience ---------------------------------------------------------------------------------------------


def test_without_patience_an_alarm_is_raised_and_cleared_at_once() -> None:
    book = AlarmBook()
    assert book.raise_(hot(1)) == [hot(1)]
    (over,) = book.clear("hot", 5, "Resolved: the motor is cool.")
    assert over == hot(5, since=1, active=False, statement="Resolved: the motor is cool.")
    assert book.clear("hot", 6, "…") == [] and list(book) == []


def test_observations_in_a_row_raise_and_clear() -> None:
    book, after = AlarmBook(), Patience(3)
    assert [book.raise_(hot(t), after=after) for t in (1, 2)] == [[], []]
    assert book.clear("hot", 3, "…", after=after) == [], "one that does not hold begins the count anew"
    assert [told(book.raise_(hot(t), after=after)) for t in (4, 5, 6)] == [[], [], [(True, 6)]]
    assert [book.clear("hot", t, "…", after=after) for t in (7, 8)] == [[], []]
    assert book.raise_(hot(9), after=after, update=False) == []
    cleared = [book.clear("hot", t, "Cool {times} times.", after=after) for t in (10, 11, 12)]
    assert [told(c) for c in cleared] == [[], [], [(False, 12)]]
    assert cleared[2][0].statement == "Cool 3 times."


def test_a_condition_that_must_hold_for_a_time() -> None:
    book, after = AlarmBook(), Patience(seconds=2.0)
    raised = [book.raise_(hot(t * SECOND), after=after) for t in range(4)]
    assert [len(r) for r in raised] == [0, 0, 1, 1]
    cleared = [book.clear("hot", t * SECOND, "…", after=after) for t in range(5, 9)]
    assert [len(c) for c in cleared] == [0, 0, 1, 0]


def test_an_update_keeps_since_and_tells_the_new_figures(raised: AlarmBook) -> None:
    assert raised.raise_(hot(4, severity="error")) == [hot(4, severity="error", since=1)]
    assert raised.raise_(hot(5), update=False) == []
    assert raised["hot"].alarm.severity == "error"
    assert raised.clear("hot", 9, "…")[0].since == 1


# damping ----------------------------------------------------------------------------------------------


def flapping(book: AlarmBook) -> list[Alarm]:
    """Raised and cleared each second; the last clear is at 7 s."""
    out = []
    for n in range(4):
        out += book.raise_(hot(2 * n * SECOND))
        out += book.clear("hot", (2 * n + 1) * SECOND, "Resolved: the motor is cool.")
    return out


def test_an_alarm_that_comes_and_goes_stays_raised_and_says_so_once() -> None:
    book = AlarmBook(DAMPING)
    said = flapping(book)
    assert told(said) == [(s % 2 == 0, s * SECOND) for s in range(5)] + [(True, 5 * SECOND)]
    assert said[-1].statement.startswith(
        "The motor is hot. The condition comes and goes; the alarm stays active until it"
    )
    assert "hot" in book and not book["hot"].holds
    assert book["hot"].flaps == 2


def test_one_that_stays_away_is_cleared_with_the_number_of_its_flaps() -> None:
    book = AlarmBook(DAMPING)
    flapping(book)
    assert book.look(36 * SECOND) == []
    (over,) = book.look(37 * SECOND)
    assert (over.active, over.time, over.statement) == (False, 37 * SECOND, "Resolved: the motor is cool.")
    assert over.evidence == {"flaps": 2}
    assert list(book) == []


def test_one_that_stays_is_an_alarm_like_any_other_again() -> None:
    book = AlarmBook(DAMPING)
    flapping(book)
    assert book.raise_(hot(8 * SECOND)) == []
    (steady,) = book.look(38 * SECOND)
    assert steady == hot(38 * SECOND, since=4 * SECOND)
    assert told(book.clear("hot", 39 * SECOND, "…")) == [(False, 39 * SECOND)]


def test_one_that_becomes_graver_while_it_flaps_is_told() -> None:
    book = AlarmBook(DAMPING)
    flapping(book)
    (graver,) = book.raise_(hot(9 * SECOND, severity="error"))
    assert graver.severity == "error" and graver.evidence["flaps"] == 2


# people -----------------------------------------------------------------------------------------------


def test_an_acknowledged_alarm_that_comes_back_is_unacknowledged(raised: AlarmBook) -> None:
    raised.acknowledge("hot", "Ines", "fan ordered", 3)
    raised.raise_(hot(4))
    said = raised["hot"].acknowledgement
    assert said is not None and (said.name, said.note, said.time) == ("Ines", "fan ordered", 3)
    raised.clear("hot", 5, "…")
    raised.raise_(hot(6))
    assert raised["hot"].acknowledgement is None


def test_of_an_alarm_on_the_shelf_nothing_is_published_before_its_time(shelved: AlarmBook) -> None:
    assert shelved.raise_(hot(3, joint=2)) == []
    assert shelved.look(9) == []
    assert shelved.look(10) == [hot(10, since=1, joint=2)]
    assert shelved.look(11) == [] and shelved["hot"].shelf is None


def test_the_shelf_ends_where_the_severity_rises(shelved: AlarmBook) -> None:
    assert shelved.raise_(hot(3, severity="info")) == []
    assert shelved.raise_(hot(4, severity="error")) == [hot(4, severity="error", since=1)]
    assert told(shelved.clear("hot", 5, "…")) == [(False, 5)], "it is off the shelf"


def test_off_the_shelf_an_alarm_is_told_as_it_is(shelved: AlarmBook) -> None:
    assert shelved.clear("hot", 3, "Resolved: cool.") == []
    assert told(shelved.unshelve("hot", 4)) == [(False, 4)]
    with pytest.raises(CellwattError, match="'hot' is not shelved"):
        shelved.unshelve("hot", 5)


def test_an_alarm_of_another_book_is_adopted_as_it_stands(shelved: AlarmBook) -> None:
    book = AlarmBook()
    book.raise_(hot(5))
    book.adopt(json.loads(json.dumps(shelved.words())))
    assert book["hot"].shelf is not None and book.look(9) == []


def test_only_an_alarm_that_is_up_is_acknowledged_or_shelved() -> None:
    book = AlarmBook()
    book.raise_(hot(1), after=Patience(2))
    with pytest.raises(CellwattError, match="no alarm 'hot' is active"):
        book.acknowledge("hot", "Ines", "", 2)
    with pytest.raises(CellwattError, match="no alarm 'cold' is active"):
        book.shelve("cold", 9, "Ines", "", 2)


# what holds of every course ----------------------------------------------------------------------------

STEPS = st.lists(
    st.tuples(
        st.integers(0, 20 * SECOND),
        st.sampled_from(["raise", "raise", "clear", "clear", "look", "acknowledge", "shelve"]),
        st.sampled_from(["hot", "loud"]),
        st.sampled_from(SEVERITIES),
    ),
    max_size=60,
)
BOOKS = st.sampled_from([None, DAMPING])
PATIENCE = st.builds(Patience, st.integers(1, 3), st.sampled_from([0.0, 5.0]))
Step = tuple[int, str, str, Any]


def do(book: AlarmBook, step: Step, now: int, after: Patience = AT_ONCE) -> list[Alarm]:
    _, what, name, severity = step
    if what == "raise":
        return book.raise_(hot(now, name, severity=severity), after=after)
    if what == "clear":
        return book.clear(name, now, "Resolved.", after=after)
    if what == "look":
        return book.look(now)
    if name in book and what == "acknowledge":
        book.acknowledge(name, "Ines", "", now)
    elif name in book:
        book.shelve(name, now + 25 * SECOND, "Ines", "", now)
    return []


def run(book: AlarmBook, steps: Sequence[Step], after: Patience = AT_ONCE) -> list[list[Alarm]]:
    now, out = 0, []
    for step in steps:
        now += step[0]
        out.append(do(book, step, now, after))
    return out


@given(STEPS, BOOKS, PATIENCE)
def test_a_clear_follows_a_raise_and_since_stays(steps: list[Step], damping: Damping | None, after: Patience) -> None:
    up: dict[str, Alarm] = {}
    last = 0
    for message in (m for said in run(AlarmBook(damping), steps, after) for m in said):
        assert message.time >= last
        last = message.time
        before = up.pop(message.id, None)
        assert message.active or before is not None
        if message.active:
            up[message.id] = message


@given(STEPS)
def test_damping_bounds_how_often_an_alarm_is_raised(steps: list[Step]) -> None:
    times: dict[str, list[int]] = {"hot": [], "loud": []}
    up: set[str] = set()
    for message in (m for said in run(AlarmBook(DAMPING), steps) for m in said):
        if message.active and message.id not in up:
            times[message.id].append(message.time)
        (up.add if message.active else up.discard)(message.id)
    for raises in times.values():
        for at in raises:
            assert sum(0 <= t - at < DAMPING.seconds * 1e9 for t in raises) <= DAMPING.times + 1


@given(STEPS, BOOKS)
def test_in_the_end_what_is_published_is_what_holds(steps: list[Step], damping: Damping | None) -> None:
    book = AlarmBook(damping)
    said = [m for messages in run(book, steps) for m in messages]
    end = sum(step[0] for step in steps) + HOUR
    said += book.look(end)
    published = {m.id: m.active for m in said}
    holds = {step[2]: step[1] == "raise" for step in steps if step[1] in ("raise", "clear")}
    assert {i for i, active in published.items() if active} == {i for i, yes in holds.items() if yes}
    assert {s.alarm.id for s in book.raised} == set(book) == {i for i, yes in holds.items() if yes}
    assert book.look(end + HOUR) == []


@given(STEPS, BOOKS, PATIENCE, st.integers(0, 60))
def test_a_book_restored_from_its_state_goes_on_as_before(
    steps: list[Step], damping: Damping | None, after: Patience, cut: int
) -> None:
    """Replay gives the same alarms, also where the state went through JSON between two steps."""
    whole = run(AlarmBook(damping), steps, after)
    now, book, out = 0, AlarmBook(damping), []
    for n, step in enumerate(steps):
        if n == cut:
            before, book = book, AlarmBook(damping)
            book.adopt(json.loads(json.dumps(before.state())))
        now += step[0]
        out.append(do(book, step, now, after))
    assert out == whole


@given(STEPS, PATIENCE)
def test_patience_delays_and_never_invents(steps: list[Step], after: Patience) -> None:
    """A message is the step's own condition, held for as long and as often as asked."""
    steps = [step for step in steps if step[1] in ("raise", "clear")]
    row: dict[str, list[tuple[str, int]]] = {"hot": [], "loud": []}
    up: set[str] = set()
    now, book = 0, AlarmBook()
    for step in steps:
        now += step[0]
        seen = row[step[2]]
        if seen and seen[-1][0] != step[1]:
            seen.clear()
        seen.append((step[1], now))
        for message in do(book, step, now, after):
            if message.active == (message.id in up):
                continue
            assert message.active == (step[1] == "raise")
            assert len(seen) >= after.times and now - seen[0][1] >= after.seconds * 1e9
        up = {s.alarm.id for s in book.raised}
