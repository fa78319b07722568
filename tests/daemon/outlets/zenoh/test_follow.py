from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt import Alarm, ProtocolError, Task
from cellwatt.outlets.zenoh.follow import GRACE, Following
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Follower, Message
from tests.daemon.outlets.zenoh.fake_cell import alarm, batch, frames, task

RAW = "raw/arm/samples"
WANTED = ("raw", "alarm")
BLOCKS = {RAW: batch, "frame": frames}
RECORDED = (*BLOCKS, "task")
TOPICS = (*RECORDED, "alarm")


def item(topic: str, number: int) -> Alarm | Task:
    return task(number) if topic == "task" else alarm(number)


def mark(session: int, first: int, count: int = 1) -> Mark:
    return Mark(session, first, count, 0)


def numbers(parts: list[Message]) -> list[tuple[int, int]]:
    return [(p.session, n) for p in parts for n in range(p.sequence, p.end)]


def raw(following: Following, first: int, count: int = 1, session: int = 1) -> list[Message]:
    return following.message(RAW, mark(session, first, count), batch(first, count))


def test_what_is_early_waits_for_what_is_missing() -> None:
    following = Following(WANTED)
    following.told(1, {RAW: (1, 0)}, 0.0)
    assert raw(following, 3, 2) == raw(following, 5) == []
    (question,) = following.questions(0.0)
    assert (question.hole.first, question.hole.count, question.hole.certain) == (0, 3, True)
    given_out = following.filled(question, [(mark(1, 0, 3), batch(0, 3))])
    assert [(p.sequence, p.end, p.backfilled) for p in given_out] == [(0, 3, True), (3, 5, False), (5, 6, False)]


def test_a_session_is_entered_when_the_cell_names_it_and_not_before() -> None:
    following = Following(WANTED)
    following.told(1, {RAW: (1, 1)}, 0.0)
    assert not following.asks_told(10.0), "nothing is unknown"
    assert raw(following, 0, 3, session=7) == []
    following.hinted(7, {RAW: (7, 3)})
    assert following.questions(10.0) == [] and following.cell == 1
    assert following.asks_told(10.0)
    following.told(1, {RAW: (1, 1)}, 10.0)
    assert numbers(raw(following, 1)) == [(1, 1)], "a message of another session ended this one"
    assert raw(following, 0, 3, session=8) == []
    assert following.asks_told(20.0)
    following.told(8, {RAW: (8, 3)}, 20.0)
    following.sessions([1, 8], 20.0)
    (question,) = following.questions(20.0)
    assert numbers(following.nothing(question, "over", 20.0)) == [(8, 0), (8, 1), (8, 2)]


def test_a_topic_that_appears_later_is_followed_from_its_first_number_once_the_cell_names_it() -> None:
    following = Following(WANTED)
    following.told(1, {}, 0.0)
    assert following.message("alarm", mark(7, 3), alarm(3)) == raw(following, 5) == []
    assert following.asks_told(10.0)
    assert following.told(1, {RAW: (1, 6)}, 10.0) == []
    (question,) = following.questions(20.0)
    assert (question.topic, question.hole.first, question.hole.count) == (RAW, 0, 5)
    assert following.message("alarm", mark(1, 0), alarm(0)) == []
    assert numbers(following.told(1, {RAW: (1, 6), "alarm": (1, 1)}, 30.0)) == [(1, 0)]


def test_a_message_of_an_ended_session_before_the_first_answer_is_not_where_a_consumer_begins() -> None:
    following = Following(WANTED)
    assert numbers(raw(following, 90, 5, session=1)) == [(1, n) for n in range(90, 95)]
    following.told(2, {RAW: (2, 7)}, 0.0)
    assert following.begun == {RAW: (2, 7)} and following.questions(10.0) == []


def test_an_answer_with_more_topics_than_a_cell_has_is_not_the_last_one() -> None:
    following = Following(WANTED)
    with pytest.raises(ProtocolError, match="more than 1000 topics"):
        following.told(1, {f"raw/more{n}/samples": (1, 0) for n in range(1001)}, 0.0)
    assert following.asks_told(10.0)


def test_only_what_is_wanted_is_followed() -> None:
    following = Following(("raw/arm", "prediction/power"))
    assert following.wants("raw/arm/samples")
    assert not following.wants("raw/arm2/samples")
    assert following.wants("prediction/power")
    assert not following.wants("prediction/powerful")


def test_what_is_only_announced_gets_time_to_arrive() -> None:
    following = Following(WANTED)
    raw(following, 0)
    following.told(1, {RAW: (1, 5)}, 0.0)
    assert following.questions(10.0) == []
    assert following.questions(10.0 + 0.9 * GRACE) == []
    raw(following, 1, 4)
    assert following.questions(11.0) == []
    following.told(1, {RAW: (1, 9)}, 0.0)
    assert following.questions(12.0) == []
    assert [q.topic for q in following.questions(12.0 + GRACE)] == [RAW]
    assert following.questions(13.0) == [], "asked twice"


def test_nobody_there_is_asked_again_for_ever() -> None:
    following = Following(WANTED, patience=1.0)
    following.told(1, {RAW: (1, 0)}, 0.0)
    raw(following, 5)
    (question,) = following.questions(0.0)
    for now in range(1, 100):
        following.unanswered(question, float(now))
        assert following.questions(now + 0.1) == []
        (question,) = following.questions(now + 0.6)
    assert following.counts["lost"] == 0


# one topic --------------------------------------------------------------------------------------------


def part(first: int, count: int, session: int = 1, backfilled: bool = False) -> Message:
    return Message(RAW, session, first, backfilled, batch(first, count))


def spans(parts: list[Message]) -> list[tuple[int, int, int]]:
    return [(p.session, p.sequence, p.end) for p in parts]


def test_a_session_may_have_a_lower_number_where_the_clock_was_set_back() -> None:
    follower = Follower(RAW, 100, 3)
    follower.announce(50, 1)
    tail = follower.hole()
    assert tail is not None
    assert follower.take(part(0, 1, session=50)) == []
    assert spans(follower.give_up(tail, "")) == [(50, 0, 1)]
    assert follower.take(part(3, 1, session=100)) == []
    assert follower.hole() is None


@settings(deadline=None)
@given(st.data())
def test_whatever_comes_each_sample_is_given_once_in_order(data: st.DataObject) -> None:
    """Parts of two sessions arrive lost, doubled, shuffled and overlapping; holes are answered from a whole record."""
    lengths = {1: data.draw(st.integers(1, 30)), 2: data.draw(st.integers(1, 30))}
    follower = Follower(RAW, 1, 0, hold=data.draw(st.integers(1, 6)))
    given_out: list[Message] = []
    follower.announce(1, lengths[1])
    for session, length in lengths.items():
        if session == 2:
            follower.announce(2, data.draw(st.integers(0, length)))
        for _ in range(data.draw(st.integers(0, 12))):
            first = data.draw(st.integers(0, length - 1))
            given_out += follower.take(part(first, data.draw(st.integers(1, length - first)), session))
    follower.announce(2, lengths[2])
    while (hole := follower.hole()) is not None:
        available = lengths[hole.session] - hole.first
        count = min(available, data.draw(st.integers(1, 5)))
        answer = part(hole.first, count, hole.session, backfilled=True) if count else None
        given_out += follower.give_up(hole, "end") if answer is None else follower.fill(answer)
    expected = [(1, n) for n in range(lengths[1])] + [(2, n) for n in range(lengths[2])]
    assert numbers(given_out) == expected
    values = [v for p in given_out for v in p.content.values[:, 0]]  # type: ignore[union-attr]
    assert values == [n for _, n in expected]


# all of them --------------------------------------------------------------------------------------------


@dataclass
class World:
    """A cell and the link to a consumer, in virtual time; ``step`` is a tenth of a second."""

    following: Following = field(default_factory=lambda: Following((*WANTED, "frame", "task")))
    session: int = 1
    up: bool = True
    now: float = 0.0
    made: dict[str, dict[int, int]] = field(default_factory=lambda: {topic: {} for topic in TOPICS})
    given_out: dict[str, list[Message]] = field(default_factory=lambda: {topic: [] for topic in TOPICS})
    joined: dict[str, tuple[int, int]] = field(default_factory=dict)

    def make(self, topic: str, count: int, arrives: bool) -> None:
        first = self.made[topic].get(self.session, 0)
        self.made[topic][self.session] = first + count
        for n, c in [(first, count)] if topic in BLOCKS else [(first + i, 1) for i in range(count)]:
            if self.up and arrives:
                content = BLOCKS[topic](n, c) if topic in BLOCKS else item(topic, n)
                self.given_out[topic] += self.following.message(topic, mark(self.session, n, c), content)

    @property
    def positions(self) -> dict[str, tuple[int, int]]:
        return {t: (self.session, s[self.session]) for t, s in self.made.items() if self.session in s}

    def beat(self) -> None:
        if self.up:
            self.following.hinted(self.session, self.positions)

    def tell(self) -> None:
        if not self.up:
            self.following.untold(self.now)
            return
        for part in self.following.told(self.session, self.positions, self.now):
            self.given_out[part.topic].append(part)

    def answer(self) -> None:
        self.now += 0.1
        if self.following.asks_told(self.now):
            self.tell()
        if self.following.asks_sessions(self.now):
            recorded = sorted({session for topic in RECORDED for session in self.made[topic]})
            self.following.sessions(recorded if self.up else None, self.now)
        for question in self.following.questions(self.now):
            if not self.up:
                self.following.unanswered(question, self.now)
                continue
            hole, made = question.hole, self.made[question.topic]
            count = min(made.get(hole.session, 0) - hole.first, 3, hole.count or 3)
            if count <= 0:
                self.given_out[question.topic] += self.following.nothing(question, "nothing", self.now)
            elif question.topic in BLOCKS:
                found = [(mark(hole.session, hole.first, count), BLOCKS[question.topic](hole.first, count))]
                self.given_out[question.topic] += self.following.filled(question, found)
            else:
                numbers = range(hole.first, hole.first + count)
                items = [(mark(hole.session, n), item(question.topic, n)) for n in numbers]
                self.given_out[question.topic] += self.following.filled(question, items)


STEPS = st.one_of(
    st.tuples(st.just("make"), st.sampled_from(TOPICS), st.integers(1, 4), st.booleans()),
    st.sampled_from([("beat",), ("answer",), ("cut",), ("restore",), ("restart",)]),
)


@given(st.lists(STEPS, max_size=50))
@settings(deadline=None)
def test_cuts_losses_and_restarts_lose_and_double_nothing(steps: list[tuple]) -> None:
    world = World()
    world.tell()
    for name, *arguments in steps:
        if name == "make":
            world.make(*arguments)
        elif name == "restart":
            world.answer()
            world.session += 1
        elif name in ("cut", "restore"):
            world.up = name == "restore"
        else:
            getattr(world, name)()
    world.up = True
    for topic in TOPICS:
        world.make(topic, 1, arrives=True)
    for _ in range(300):
        world.beat()
        world.answer()
    assert not any(follower.hole() for follower in world.following._topics.values())
    for topic, sessions in world.made.items():
        seen = numbers(world.given_out[topic])
        known = {session for session, _ in seen}
        assert world.session in known
        # The record has no numbers of alarms: of a session in which a cut let nothing through nobody is left to tell.
        owed = [s for s in sorted(sessions) if topic in RECORDED or s in known]
        assert seen == [(s, n) for s in owed for n in range(sessions[s])]
