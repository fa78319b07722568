"""A consumer's question over Zenoh, and its answer."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cellwatt.batch import Batch
from cellwatt.errors import CellwattError
from cellwatt.frames import Frames
from cellwatt.outlet import CellView
from cellwatt.outlets.zenoh.answer_queue import MOST_RESULTS, MOST_SAMPLES, Answer
from cellwatt.outlets.zenoh.answers import Answers
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.encode import ARROW, decode
from cellwatt.outlets.zenoh.keys import CellKeys
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.questions import parameters
from cellwatt.results import Alarm, Event, Result
from fuzz.items import MESSAGES, SESSION, batch, frames
from fuzz.target import Target


class _View(CellView):
    """A cell of which three batches are recorded."""

    site, cell, session, journal = "plant", "weld", SESSION, None

    def status(self) -> Mapping[str, Any]:
        return {}

    def config(self) -> Mapping[str, Any]:
        return {"site": "plant"}

    def schema(self) -> Mapping[str, Any]:
        return {}

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        return []

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        assert 0 <= count <= MOST_SAMPLES
        if (source, stream, session) != ("arm", "rtde", SESSION):
            return []
        return [b for b in (batch(0, 4), batch(4, 3), batch(9, 2)) if b.sequence < first + count]

    def frame_history(self, session: int, first: int, count: int) -> Sequence[Frames]:
        assert 0 <= count <= MOST_SAMPLES
        return [f for f in (frames(0, 4), frames(4, 2)) if session == SESSION and f.sequence < first + count]

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        assert 0 <= count <= MOST_RESULTS
        kept = [(n, Event(n, "arm", "connected", "")) for n in range(first, min(first + count, 10))]
        return kept if (series, session) == ("event", SESSION) else []


def _answers() -> Answers:
    view = _View()
    backlog = Backlog(SESSION)
    for message in MESSAGES:
        if hasattr(message, "source") or hasattr(message, "model"):
            backlog.add(message)
    backlog.add(Alarm("a1", "joint_fault", "error", False, 1, 2, "over"))
    return Answers(
        view, CellKeys("plant", "weld"), backlog, lambda _: None, lambda: Answer(b"{}", mark=Mark(SESSION, 0, 1, 5))
    )


ANSWERS = _answers()


def run(data: bytes) -> None:
    """``name?parameters``, as text that Zenoh hands over: always UTF-8."""
    name, _, text = data.decode("utf-8", "replace").partition("?")
    try:
        asked = parameters(text)
    except CellwattError:
        return
    try:
        answer = ANSWERS.about(name, asked)
    except CellwattError as error:
        assert len(str(error)) < 1000 + 3 * len(data)
    else:
        assert len(answer.payload) < 100_000
        if answer.encoding == ARROW:
            assert answer.mark is not None
            content = decode(answer.payload, answer.mark)
            assert 0 < len(content) == answer.mark.count
        else:
            json.loads(answer.payload)
    try:
        assert len(ANSWERS.alarms(asked)) <= MOST_RESULTS
    except CellwattError:
        return


def seeds() -> Iterable[bytes]:
    """Each question."""
    yield from (b"status", b"config", b"schema", b"recordings", b"history", b"results")
    session = f"session={SESSION}"
    yield f"history?source=arm;stream=rtde;{session};first=2;count=4".encode()
    yield f"history?stream=frame;{session};first=1;count=3".encode()
    yield f"results?kind=alarm;{session};first=0;count=5".encode()
    yield f"results?kind=prediction%2Fpower;{session}".encode()
    yield b"?cleared=-5"
    yield b"?cleared=2"
    yield b"?cleared=" + b"9" * 4400


TARGET = Target(run, seeds, 5000)
