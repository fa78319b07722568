"""The pace of answers about the past, and who comes first."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings
from cellwatt.outlets.zenoh.answers import Answers
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.past import MOST_SAMPLES, Pace, Turns
from cellwatt.subscriber import Subscriber
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, alarm, batch, frames
from tests.daemon.outlets.zenoh.processes import free_port
from tests.daemon.outlets.zenoh.serving import serving
from tests.patience import PATIENCE, eventually

SAMPLE = 33 + 3 * 8
"""Bytes of a sample of the fake cell, about."""


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.integers(1, 10**6)), max_size=50), st.floats(1e3, 1e7))
def test_never_more_than_the_rate_beside_one_piece(pieces: list[tuple[float, int]], rate: float) -> None:
    pace, now, sent = Pace(rate), 100.0, 0
    for pause, size in pieces:
        now += pause + pace.delay(now + pause)
        assert sent <= rate * (now - 100.0) * (1 + 1e-9) + 1
        pace.spend(size, now)
        sent += size


def test_without_a_limit_nothing_waits() -> None:
    pace = Pace(None)
    pace.spend(10**12, 5.0)
    assert pace.delay(5.0) == 0.0
    assert pace.piece(63) == float("inf")


def test_all_that_wait_have_their_turn_before_they_give_up() -> None:
    for waiting in range(64):
        assert (1 + waiting) * Pace(1e6).piece(waiting) / 1e6 <= 2.0 + 1e-9
    assert Pace(1e6).piece(0) == 250e3


def test_questions_about_now_overtake_those_about_the_past() -> None:
    held: list[bool] = []
    pace = Pace(1000.0)
    turns = Turns(pace, 10, lambda: held.append(True))
    done: list[str] = []
    pace.spend(100, time.monotonic())  # the next may go in 0.1 s
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
    pace = Pace(1.0)
    turns = Turns(pace, 3, lambda: None)
    pace.spend(3600, time.monotonic())
    assert [turns.put(lambda: None, True) for _ in range(4)] == [True, True, True, False]
    taker = threading.Thread(target=turns.take)
    taker.start()
    turns.end()  # also while what waits has to wait an hour
    taker.join(PATIENCE)
    assert not taker.is_alive()
    assert turns.waiting == 3
    assert not turns.put(lambda: None, False)


@pytest.fixture
def answers() -> Answers:
    view, backlog = FakeView(), Backlog(EPOCH, 1e9)
    view.record(batch(0, 3 * MOST_SAMPLES))
    backlog.add_frames(frames(0, 3000))
    for number in range(500):
        backlog.add(alarm(number))
    return Answers(
        view, CellKeys(SITE, CELL), backlog, lambda *_: None, lambda: (Mark(EPOCH, 0, 1, EPOCH), b"{}"), rate=20e3
    )


@pytest.mark.parametrize(
    "asked",
    [{"source": "arm", "stream": "samples"}, {"stream": "frame"}],
)
def test_an_answer_is_a_quarter_of_a_second_of_the_limit(answers: Answers, asked: dict[str, str]) -> None:
    for _ in range(2):  # before and after the size of a sample is known
        answer = answers.about("history", asked | {"first": "7"})
        assert answer.mark is not None
        assert answer.mark.sequence == 7
        assert 5000 / SAMPLE / 2 < answer.mark.count < 2 * 5000 / SAMPLE


def test_results_of_an_answer_fit_the_limit_too(answers: Answers) -> None:
    answer = answers.about("results", {"kind": "alarm", "first": "3"})
    assert answer.mark is not None
    found = json.loads(answer.payload)
    assert [a["mark"]["sequence"] for a in found] == list(range(3, 3 + answer.mark.count))
    assert 5000 <= len(answer.payload) < 7000


@pytest.mark.parametrize("value", ["0 B/s", "-1 MB/s", "2 MB", "fast"])
def test_a_limit_that_is_none_is_refused(value: str) -> None:
    with pytest.raises(ValidationError, match="backfill"):
        ZenohSettings(backfill=value)  # type: ignore[arg-type]


async def test_a_consumer_gets_all_of_the_past_at_the_limit_and_status_at_once() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    limit, samples = 100e3, 2000
    outlet = ZenohOutlet("zenoh", ZenohSettings(listen=(endpoint,), backfill=limit), view := FakeView())
    view.record(batch(0, samples))
    link = LinkSettings(mode="client", connect=(endpoint,))
    status = f"cellwatt/{SITE}/{CELL}/@/status"
    async with serving(outlet):
        outlet.offer(batch(samples - 1, 1))
        session: Any = await asyncio.to_thread(open_session, link, patience=PATIENCE)
        with session:
            began = time.monotonic()
            resume = {"raw/arm/samples": (EPOCH, 0)}
            async with Subscriber(SITE, CELL, link, want=("raw",), resume=resume) as cell:
                following = 0
                async for message in cell:
                    assert message.sequence == following
                    following += message.count
                    if following == samples:
                        break
                    if message.backfilled:
                        (reply,) = await asyncio.to_thread(lambda: list(session.get(status)))
                        assert reply.ok is not None
            took = time.monotonic() - began
            assert cell.counts["backfilled"] >= samples - 1
    counters = outlet.account.counters
    size = counters["bytes of the past"]
    assert size > samples * 8 * 3
    # The last piece goes out at its begin.
    assert took > (size - limit / 4) / limit - 0.3
    assert counters["answers about the past"] >= 4
    assert counters["answers held back"] >= 3


async def test_an_answer_has_the_priority_of_its_question() -> None:
    """So what ``Subscriber`` asks for goes below live messages on every line."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    view = FakeView()
    view.record(batch(0, 10))
    outlet = ZenohOutlet("zenoh", ZenohSettings(listen=(endpoint,)), view)
    async with serving(outlet):
        link = LinkSettings(mode="client", connect=(endpoint,))
        session: Any = await asyncio.to_thread(open_session, link, patience=PATIENCE)
        with session:
            question = f"cellwatt/{SITE}/{CELL}/@/history?source=arm;stream=samples"

            def ask() -> Any:
                replies = list(session.get(question, priority=zenoh.Priority.DATA_LOW))
                return replies[0].ok if replies else None

            sample = await eventually(lambda: asyncio.to_thread(ask), "an answer")
            assert sample.priority == zenoh.Priority.DATA_LOW
