from __future__ import annotations

import pytest

from cellwatt import CellwattError
from cellwatt.outlets.zenoh.answers import Answers
from cellwatt.outlets.zenoh.backlog import ALARMS_KEPT, Backlog
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.past import MOST_RESULTS, MOST_SAMPLES
from cellwatt.outlets.zenoh.questions import QuestionError
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, alarm, batch, frames

NUMBERING = EPOCH + 5
HEALTH = Mark(EPOCH, 3, 1, EPOCH, backfill=True)


@pytest.fixture
def view() -> FakeView:
    return FakeView()


@pytest.fixture
def backlog() -> Backlog:
    return Backlog(NUMBERING, 1e6)


@pytest.fixture
def answers(view: FakeView, backlog: Backlog) -> Answers:
    return Answers(view, CellKeys(SITE, CELL), backlog, lambda what: None, lambda: (HEALTH, b'{"status": {}}'))


def test_history_ends_at_a_hole_and_is_bounded(answers: Answers, view: FakeView) -> None:
    view.record(batch(0, 10))
    view.record(batch(12, 2 * MOST_SAMPLES))
    asked = {"source": "arm", "stream": "samples"}
    assert answers.about("history", asked).mark == Mark(EPOCH, 0, 10, EPOCH, backfill=True)
    bounded = answers.about("history", asked | {"first": "12", "count": "999999"}).mark
    assert bounded is not None
    assert (bounded.sequence, bounded.count) == (12, MOST_SAMPLES)


@pytest.mark.parametrize(
    ("name", "asked", "text"),
    [
        ("hist", {}, r"there is no question 'hist'; there are: status, config, .*results"),
        ("history", {}, "needs source="),
        ("history", {"source": "arm"}, "needs stream="),
        ("history", {"source": "arm", "stream": "samples"}, "nothing is recorded of arm/samples from 0"),
        ("history", {"source": "arm", "stream": "samples", "first": "x"}, "first='x' is not a whole number"),
        ("history", {"source": "arm", "stream": "samples", "first": "-1"}, "first='-1' is not a whole number"),
        ("history", {"source": "arm", "stream": "samples", "count": "²"}, "count='²' is not a whole number"),
        ("history", {"stream": "frame", "first": "3"}, "no frames are kept from 3"),
        ("results", {}, "needs kind="),
        ("results", {"kind": "task"}, "no results 'task' are kept"),
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

    for first in range(0, 60_000, 10):  # of these 1 MB is kept
        backlog.add_frames(frames(first, 10))
    (begin, _), *_ = backlog.frames(NUMBERING, 0, 10**6)
    assert begin.sequence > 2 * MOST_SAMPLES
    asked = {"stream": "frame", "session": str(NUMBERING), "first": "3"}
    mark = answers.about("history", asked | {"count": "60000"}).mark
    assert mark is not None
    assert (mark.sequence, mark.count) == (begin.sequence, MOST_SAMPLES)
    mark = answers.about("history", asked | {"count": str(begin.sequence + 2)}).mark
    assert mark is not None
    assert (mark.sequence, mark.count) == (begin.sequence, 5)

    for number in range(ALARMS_KEPT + 2 * MOST_RESULTS):
        backlog.add(alarm(number, active=False))
    mark = answers.about("results", {"kind": "alarm", "first": "3", "count": "100000"}).mark
    assert mark is not None
    assert (mark.sequence, mark.count) == (2 * MOST_RESULTS, MOST_RESULTS)
