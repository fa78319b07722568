"""Questions as somebody hostile asks them: each is answered or refused, counted, and the next one is answered."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from functools import cache
from itertools import product
from typing import Any

import pytest
import zenoh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cellwatt import CellwattError, OutletError
from cellwatt.outlets.zenoh.answers import Answers
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.outlets.zenoh.questions import LARGEST, QuestionError, number_of, parameters
from cellwatt.runtime.delivery import Delivery
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, alarm, batch, frames
from tests.daemon.outlets.zenoh.test_answers import answers_of
from tests.daemon.outlets.zenoh.test_subscriber import Cell
from tests.doing import doing
from tests.patience import PATIENCE, eventually

ROOT = f"cellwatt/{SITE}/{CELL}"

# pure ---------------------------------------------------------------------------------------------------

NO_NUMBERS = ("-5", "-0", "", " 1", "1e3", "0x10", "1.5", "nan", "inf", "²", "١", "%ff", "\0")
NUMBERS = (*NO_NUMBERS, "9" * 19, "9" * 5000, str(2**63))
NAMES = ("session", "first", "count", "cleared")


@pytest.mark.parametrize("text", NUMBERS)
def test_what_is_no_number_is_refused_in_a_short_line(text: str) -> None:
    with pytest.raises(QuestionError, match=r"^first=.* is (not a whole number|too large)$") as caught:
        number_of({"first": text}, "first", 0)
    assert len(str(caught.value)) < 120
    assert str(caught.value).isprintable()


def test_parameters_without_end_are_refused_and_odd_ones_are_text() -> None:
    with pytest.raises(QuestionError, match="may have 4096 characters of parameters, this one has 500000"):
        parameters("a=1;b" * 100_000)
    assert parameters("=1;;a;b=%ff%00;b==;c=1=2") == {"a": "", "b": "=", "c": "1=2"}


@cache
def filled() -> Answers:
    view, backlog = FakeView(), Backlog(EPOCH)
    for first in range(0, 50, 10):
        view.record(batch(first, 10))
        view.record(frames(first, 10))
    for number in range(5):
        backlog.add(alarm(number))
        backlog.add(alarm(number, active=False))
    return answers_of(view, backlog)


VALUES = st.one_of(
    st.sampled_from([*NUMBERS, "0", "3", str(EPOCH), "frame", "alarm", "arm", "samples", "arm/../x", "**", "@", "%2F"]),
    st.text(max_size=20),
    st.integers(-(2**70), 2**70).map(str),
)


@given(
    st.sampled_from(["history", "results", "status", "nothing"]),
    st.dictionaries(st.sampled_from([*NAMES, "source", "stream", "kind"]), VALUES),
)
@example("history", {"stream": "frame", "first": str(2**62 - 1), "count": str(2**62 - 1)})
@example("history", {"source": "arm", "stream": "samples", "first": str(2**62 - 1), "count": str(2**62 - 1)})
@settings(deadline=None)
def test_any_parameters_get_an_answer_or_a_reason(name: str, asked: dict[str, str]) -> None:
    answers = filled()
    try:
        answer = answers.about(name, asked)
        if answer.mark is not None:
            answer.mark.encode(answer.payload)
        answers.alarms(asked)
    except CellwattError as error:
        assert len(str(error)) < 300


# over real sessions -------------------------------------------------------------------------------------


class Asked(Cell):
    """An outlet that serves, and somebody who asks it."""

    session: Any = None

    async def ask(self, selector: str, **more: Any) -> list[zenoh.Reply]:
        return await asyncio.to_thread(lambda: list(self.session.get(f"{ROOT}/{selector}", timeout=10.0, **more)))

    async def serves(self) -> bool:
        """Whether a question is answered now."""
        return any(r.ok is not None for r in await self.ask("@/status"))

    @property
    def counts(self) -> dict[str, int]:
        return dict(self.outlet.account.counters)


@pytest.fixture
async def cell() -> AsyncIterator[Asked]:
    found = Asked()
    async with doing(found.outlet.run(), allowed=(OutletError,)):
        with await asyncio.to_thread(open_session, found.link, patience=PATIENCE) as found.session:
            await eventually(found.serves, "an answer")
            yield found


NUMBERED = ("alarm/**?cleared={}", "@/history?stream=frame;first={}", "@/results?kind=alarm;count={}")


async def test_an_odd_number_is_an_error_reply_and_the_next_question_is_answered(cell: Asked) -> None:
    for selector, text in product(NUMBERED, ("-5", "", "nan", "9" * 5000)):
        (reply,) = await cell.ask(selector.format(text))
        assert "whole number" in (said := json.loads(reply.err.payload.to_bytes())["error"]) or "characters" in said
    assert await cell.serves()
    assert cell.counts == {"questions refused: wrong": 12}


ODD_KEYS = ("**?cleared=1", "*/**", "alarm/*/*/*", "alarm", "alarm/error/%2F", "@/*?first=-1", "@/**", "@/a/b")


async def test_odd_keys_leave_the_answers_at_work(cell: Asked) -> None:
    for selector in (*ODD_KEYS, "@/history?" + "a;" * 2000):
        await cell.ask(selector)
        assert await cell.serves(), selector
    assert "questions failed" not in cell.counts


async def test_what_is_sent_along_is_bounded(cell: Asked) -> None:
    await cell.ask("@/status", payload=bytes(LARGEST + 1))
    await cell.ask("@/status", attachment=bytes(LARGEST + 1))
    assert cell.counts == {"questions refused: too large": 2}
    assert len(await cell.ask("@/status", payload=b"\xff" * 1000, attachment=b"\xff")) == 1


# the threads themselves -----------------------------------------------------------------------------------


async def test_the_same_failure_is_logged_once_and_counted_each_time(
    cell: Asked, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(cell.view, "history", lambda *_: 1 / 0)
    for _ in range(5):
        (reply,) = await cell.ask("@/history?source=a\nb;stream=samples")
        assert json.loads(reply.err.payload.to_bytes()) == {"error": "ZeroDivisionError: division by zero"}
    assert cell.counts == {"questions failed": 5}
    assert len([r for r in caplog.records if "could not be answered" in r.getMessage()]) == 1
    assert all("\n" not in r.getMessage() for r in caplog.records)


async def test_a_thread_that_is_stuck_is_told_by_health(cell: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    import threading

    monkeypatch.setattr("cellwatt.outlets.zenoh.answers.STUCK", 0.05)
    release = threading.Event()
    delivery = Delivery("zenoh", lambda: cell.outlet)
    monkeypatch.setattr(cell.view, "history", lambda *_: release.wait(PATIENCE) and ())
    asking = asyncio.create_task(cell.ask("@/history?source=arm;stream=samples"))
    try:
        told = await eventually(lambda: delivery.status()["error"], "health to tell")
        assert "the thread that answers questions has been stuck at one for" in told
        assert delivery.status()["state"] == "down"
    finally:
        release.set()
        await asking
    await eventually(lambda: delivery.status()["state"] == "ok", "health to be well again")


async def test_health_that_cannot_be_said_costs_only_itself(cell: Asked) -> None:
    cell.outlet.health({"device": "\ud800"})
    (reply,) = await cell.ask("@/status")
    assert "UnicodeEncodeError" in (said := reply.err.payload.to_string()) or "Serialization" in said
    cell.outlet.health({"device": "arm"})
    await eventually(cell.serves, "an answer")
