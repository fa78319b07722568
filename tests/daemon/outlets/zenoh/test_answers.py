from __future__ import annotations

import asyncio
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from cellwatt import CellwattError
from cellwatt.outlets.zenoh import ZenohSettings
from cellwatt.outlets.zenoh.answer_queue import MOST_RESULTS, MOST_SAMPLES, Answer, Turns
from cellwatt.outlets.zenoh.answers import Answers
from cellwatt.outlets.zenoh.backlog import ALARMS_KEPT, Backlog
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.questions import QuestionError
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, alarm, batch
from tests.daemon.outlets.zenoh.serving import serving
from tests.daemon.outlets.zenoh.test_subscriber import RAW, Cell
from tests.patience import PATIENCE

ROOT = f"cellwatt/{SITE}/{CELL}"
NUMBERING = EPOCH + 5


@pytest.fixture
def view() -> FakeView:
    return FakeView()


@pytest.fixture
def backlog() -> Backlog:
    return Backlog(NUMBERING)


@pytest.fixture
def answers(view: FakeView, backlog: Backlog) -> Answers:
    return answers_of(view, backlog)


def answers_of(view: FakeView, backlog: Backlog) -> Answers:
    health = Answer(b'{"status": {}}', mark=Mark(EPOCH, 3, 1, EPOCH, backfill=True))
    return Answers(view, CellKeys(SITE, CELL), backlog, lambda what: None, lambda: health)


@pytest.mark.parametrize(
    ("name", "asked", "text"),
    [
        ("hist", {}, r"unknown question 'hist'; known questions: status, config, .*results"),
        ("history", {}, "needs source="),
        ("history", {"source": "arm"}, "needs stream="),
        ("history", {"source": "arm", "stream": "samples"}, "nothing is recorded of arm/samples from 0"),
        ("history", {"stream": "frame", "first": "3"}, "no frames are stored from 3"),
        ("results", {}, "needs kind="),
        ("results", {"kind": "task"}, "no results 'task' are stored"),
    ],
)
def test_questions_that_cannot_be_answered_say_why(
    answers: Answers, name: str, asked: dict[str, str], text: str
) -> None:
    with pytest.raises(QuestionError, match=text) as caught:
        answers.about(name, asked)
    assert isinstance(caught.value, CellwattError)


def test_where_the_begin_is_gone_the_answer_begins_with_what_is_left(
    answers: Answers, view: FakeView, backlog: Backlog
) -> None:
    """A consumer gives up all that an empty answer was about, so an answer is empty only if all of it is gone."""
    view.record(batch(0, 20 * MOST_SAMPLES))
    view.forgotten = 15 * MOST_SAMPLES
    asked = {"source": "arm", "stream": "samples", "first": "3"}
    mark = answers.about("history", asked | {"count": str(20 * MOST_SAMPLES)}).mark
    assert mark == Mark(EPOCH, view.forgotten, MOST_SAMPLES, EPOCH, backfill=True)
    mark = answers.about("history", asked | {"count": str(view.forgotten)}).mark
    assert mark == Mark(EPOCH, view.forgotten, 3, EPOCH, backfill=True)
    with pytest.raises(CellwattError, match="nothing is recorded of arm/samples from 3"):
        answers.about("history", asked | {"count": str(view.forgotten - 3)})

    for number in range(ALARMS_KEPT + 2 * MOST_RESULTS):
        backlog.add(alarm(number, active=False))
    mark = answers.about("results", {"kind": "alarm", "first": "3", "count": "100000"}).mark
    assert mark is not None
    assert (mark.sequence, mark.count) == (2 * MOST_RESULTS, MOST_RESULTS)


# The pace of answers about the past, and who comes first ---


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.integers(1, 10**6)), max_size=50), st.floats(1e3, 1e7))
def test_never_more_than_the_rate_beside_one_piece(pieces: list[tuple[float, int]], rate: float) -> None:
    turns, now, sent = Turns(rate, 9, lambda: None), 100.0, 0
    for pause, size in pieces:
        now += pause + turns.delay(now + pause)
        assert sent <= rate * (now - 100.0) * (1 + 1e-9) + 1
        turns.spend(size, now)
        sent += size


def test_questions_about_now_overtake_those_about_the_past() -> None:
    held: list[bool] = []
    turns = Turns(1000.0, 10, lambda: held.append(True))
    done: list[str] = []
    turns.spend(100, time.monotonic())  # the next may go in 0.1 s
    for name, past in (("history", True), ("status", False), ("results", True), ("config", False)):
        assert turns.put(lambda name=name: done.append(name), past)  # type: ignore[misc]
    for _ in range(4):
        work = turns.take()
        assert work is not None
        work()
    assert done == ["status", "config", "history", "results"]
    assert len(held) == 2
    turns.end()
    assert turns.take() is None


def test_no_more_wait_than_allowed() -> None:
    turns = Turns(1.0, 3, lambda: None)
    turns.spend(3600, time.monotonic())
    assert [turns.put(lambda: None, True) for _ in range(4)] == [True, True, True, False]
    taker = threading.Thread(target=turns.take)
    taker.start()
    turns.end()  # also while what waits has to wait an hour
    taker.join(PATIENCE)
    assert not taker.is_alive()
    assert len(turns._past) == 3
    assert not turns.put(lambda: None, False)


@pytest.mark.parametrize("value", ["0 B/s", "-1 MB/s", "2 MB", "fast"])
def test_a_limit_that_is_none_is_refused(value: str) -> None:
    with pytest.raises(ValidationError, match="backfill"):
        ZenohSettings(backfill=value)  # type: ignore[arg-type]


async def test_a_consumer_gets_all_of_the_past_at_the_limit_and_status_at_once() -> None:
    limit, samples = 100e3, 2000
    cell = Cell(backfill=limit)
    cell.give(0, samples, live=False)
    async with serving(cell.outlet) as outlet:
        outlet.offer(batch(samples - 1, 1))
        with await asyncio.to_thread(open_session, cell.link, patience=PATIENCE) as session:
            began = time.monotonic()
            async with cell.subscriber(want=("raw",), resume={RAW: (EPOCH, 0)}) as subscriber:
                following = 0
                async for message in subscriber:
                    assert message.sequence == following
                    following += message.count
                    if following == samples:
                        break
                    if message.backfilled:
                        (reply,) = await asyncio.to_thread(lambda: list(session.get(f"{ROOT}/@/status")))
                        assert reply.ok is not None
            took = time.monotonic() - began
            assert subscriber.counts["backfilled"] >= samples - 1
    counters = outlet.account.counters
    size = counters["bytes of the past"]
    assert size > samples * 8 * 3
    # The last piece goes out at its begin.
    assert took > (size - limit / 4) / limit - 0.3
    assert counters["answers about the past"] >= 4
    assert counters["answers held back"] >= 1
