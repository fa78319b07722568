"""What a subscriber does with messages, health and answers in any order."""

from __future__ import annotations

import struct
from collections.abc import Iterable

import numpy as np

from cellwatt.batch import Batch
from cellwatt.outlets.zenoh.follow import Following
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Message
from cellwatt.outlets.zenoh.questions import Question
from cellwatt.results import Event
from fuzz.items import SESSION, STREAM
from fuzz.target import Target

STEP = struct.Struct("<BbhhB")
"""What comes; session, first number and count, each near the last or, with a high bit, far away; time passed."""
TOPICS = ("event", "raw/arm/rtde", "frame")
FAR = 1 << 40


def run(data: bytes) -> None:
    """Steps of ``STEP`` each; no sample is handed out twice or out of order, and none is lost without a gap."""
    state = Following(("event", "raw", "frame"))
    reached: dict[tuple[str, tuple[int, int]], tuple[int, int]] = {}
    asked: list[Question] = []
    now = 0.0
    for at in range(0, len(data) // STEP.size * STEP.size, STEP.size):
        kind, session, first, count, passed = STEP.unpack_from(data, at)
        now += passed / 50
        topic = TOPICS[kind % len(TOPICS)]
        number, count = abs(first) * (FAR if kind & 128 else 1), 1 if topic == "event" else max(count, 1)
        mark = Mark(SESSION + session, number, count, 0)
        parts = _step(state, kind // 4 % 6, topic, mark, asked, now)
        _in_order(parts, state, reached)
    assert state.duplicates >= 0


def _step(state: Following, kind: int, topic: str, mark: Mark, asked: list[Question], now: float) -> list[Message]:
    if kind == 0:
        return state.message(topic, mark, _content(topic, mark))
    if kind == 1:
        state.hinted(mark.session, {topic: (mark.session, mark.end)})
        if state.asks_told(now):
            return state.told(mark.session, {topic: (mark.session, mark.end)}, now)
    elif kind == 2:
        asked += state.questions(now)
        if state.asks_sessions(now):
            state.sessions(None, now)
    elif kind == 3:
        state.sessions([mark.session - 1, mark.session], now)
    elif asked and kind == 4:
        question = asked.pop()
        return state.filled(question, [(mark, _content(question.topic, mark))])
    elif asked:
        question = asked.pop()
        if mark.count % 2:
            state.unanswered(question, now)
        else:
            return state.nothing(question, "gone", now)
    return []


def _content(topic: str, mark: Mark) -> Batch | Event:
    """An event, or the samples of a mark, all zero and without memory of their own."""
    if topic == "event":
        return Event(0, None, "k", "t")
    none = np.broadcast_to(np.int64(0), mark.count)
    quality, values = np.broadcast_to(np.uint8(0), mark.count), np.broadcast_to(0.0, (mark.count, 2))
    return Batch("arm", STREAM, mark.sequence, 0, time=none, bound=none, values=values, quality=quality)


def _in_order(
    parts: list[Message], state: Following, reached: dict[tuple[str, tuple[int, int]], tuple[int, int]]
) -> None:
    for part in parts:
        begun = state.begun[part.topic]  # another one if the first message heard was of an ended session
        session, following = reached.get((part.topic, begun), begun)
        assert part.count > 0
        if part.session == session:
            assert part.sequence == following, (part, following)
        reached[part.topic, begun] = (part.session, part.end)


def seeds() -> Iterable[bytes]:
    """A stream with a hole that is filled, a new session, and one that is told by health."""

    def step(kind: int, session: int, first: int, count: int, passed: int = 5) -> bytes:
        return STEP.pack(kind, session, first, count, passed)

    live, beat, ask, sessions, fill, nothing = (4 * i for i in range(6))
    yield step(beat, 0, 0, 5) + step(live, 0, 5, 1) + step(live, 0, 7, 1) + step(ask, 0, 0, 0) + step(fill, 0, 6, 1)
    yield (
        step(beat + 1, 0, 0, 5)
        + step(live + 1, 1, 0, 4)
        + step(ask, 0, 0, 0)
        + step(sessions, 1, 0, 0)
        + step(ask, 0, 0, 0)
        + step(nothing, 0, 0, 0)
    )
    yield step(live + 2, 0, 3, 2) + step(live + 2 + 128, 0, 9, 2) + step(ask, 0, 0, 0, 50) + step(nothing, 0, 0, 1)


TARGET = Target(run, seeds, 700)
