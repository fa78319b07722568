from __future__ import annotations

import threading
from collections import Counter
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt import Account, Batch, Stream
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.outbox import Lane, Outbox, Outgoing
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, HOST_STREAM, STREAM, alarm, batch, frames
from tests.patience import PATIENCE


def raw(first: int, count: int = 1, source: str = "arm", stream: Stream = STREAM) -> Outgoing:
    topic = f"raw/{source}/{stream.name}"
    return Outgoing(topic, (topic,), batch(first, count, source, stream), Mark(EPOCH, first, count, EPOCH))


def frame(first: int, count: int = 1) -> Outgoing:
    return Outgoing("frame", ("frame",), frames(first, count), Mark(EPOCH, first, count, EPOCH))


def result(number: int) -> Outgoing:
    return Outgoing("alarm", ("alarm/error/joint_fault",), alarm(number), Mark(EPOCH, number, 1, EPOCH))


def outbox(limit: int) -> tuple[Outbox, Account]:
    account = Account()
    return Outbox(limit, account), account


def take_all(box: Outbox) -> list[Outgoing]:
    taken = []
    while len(box):
        outgoing = box.take()
        assert outgoing is not None
        box.sent(outgoing)
        taken.append(outgoing)
    return taken


def test_samples_are_for_who_puts_only_while_the_thread_waits_and_no_result_does() -> None:
    box, _ = outbox(10)
    box.put(Lane.RAW, raw(0), wake=False)
    assert box.take_samples() is None, "no thread waits: it may have the samples before these in hand"
    taken: list[Outgoing | None] = []
    thread = threading.Thread(target=lambda: taken.append(box.take()))
    assert box.take() is not None
    thread.start()
    while not box._idle:
        pass
    box.put(Lane.RAW, raw(1), wake=False)
    box.put(Lane.RAW, raw(2), wake=False)
    box.put(Lane.FRAMES, frame(0), wake=False)
    assert [o.mark.sequence for o in iter(box.take_samples, None)] == [0, 1]
    assert thread.is_alive()
    box.put(Lane.RAW, raw(3), wake=False)
    box.put(Lane.RESULTS, result(0), wake=False)
    assert box.take_samples() is None
    box.wake()
    thread.join(PATIENCE)
    assert [o.topic for o in taken if o is not None] == ["alarm"]


def test_results_leave_before_frames_before_raw() -> None:
    box, _ = outbox(10)
    box.put(Lane.RAW, raw(0))
    box.put(Lane.FRAMES, frame(0))
    box.put(Lane.RESULTS, result(0))
    box.put(Lane.RESULTS, result(1))
    assert [o.topic for o in take_all(box)] == ["alarm", "alarm", "frame", "raw/arm/samples"]


def test_raw_that_waits_together_leaves_as_one_message_a_stream() -> None:
    box, account = outbox(100)
    for i in range(5):
        box.put(Lane.RAW, raw(2 * i, 2))
        box.put(Lane.RAW, raw(i, 1, "meter", HOST_STREAM))
    first, second = take_all(box)
    assert (first.topic, first.mark) == ("raw/arm/samples", Mark(EPOCH, 0, 10, EPOCH + 8))
    assert isinstance(first.item, Batch)
    assert first.item.values[:, 0].tolist() == list(range(10))
    assert (second.topic, second.mark.count) == ("raw/meter/meter", 5)
    assert account.received == 15


def test_merged_messages_stay_of_bounded_size_and_other_streams_get_their_turn() -> None:
    box, _ = outbox(100)
    for i in range(10):
        box.put(Lane.RAW, raw(300 * i, 300))
    box.put(Lane.RAW, raw(0, 1, "meter", HOST_STREAM))
    taken = take_all(box)
    assert [o.mark.count for o in taken] == [900, 1, 900, 900, 300]


def test_a_full_box_drops_the_oldest_raw_then_frames_and_results_last() -> None:
    box, account = outbox(4)
    box.put(Lane.RESULTS, result(0))
    box.put(Lane.FRAMES, frame(0, 3))
    box.put(Lane.RAW, raw(0, 5))
    box.put(Lane.RAW, raw(0, 7, "meter", HOST_STREAM))
    box.put(Lane.RAW, raw(5, 5))
    assert account.dropped == Counter({"queue: raw": 5})
    box.put(Lane.RESULTS, result(1))
    box.put(Lane.RESULTS, result(2))
    assert account.dropped == Counter({"queue: raw": 17})
    box.put(Lane.RESULTS, result(3))
    assert account.dropped == Counter({"queue: raw": 17, "queue: frames": 3})
    box.put(Lane.RESULTS, result(4))
    assert account.dropped == Counter({"queue: raw": 17, "queue: frames": 3, "queue: results": 1})
    assert [o.mark.sequence for o in take_all(box)] == [1, 2, 3, 4]
    assert (account.received, account.residue) == (4, 0)


def test_positions_are_what_no_longer_waits() -> None:
    box, _ = outbox(10)
    for first in (0, 5):
        box.put(Lane.RAW, raw(first, 5))
    box.put(Lane.RESULTS, result(0))
    assert box.positions() == {"raw/arm/samples": (EPOCH, 0), "alarm": (EPOCH, 0)}
    box.take()
    assert box.positions() == {"raw/arm/samples": (EPOCH, 0), "alarm": (EPOCH, 1)}
    box.take()
    assert box.positions() == {"raw/arm/samples": (EPOCH, 10), "alarm": (EPOCH, 1)}


LANES = st.sampled_from([(Lane.RAW, "arm"), (Lane.RAW, "meter"), (Lane.FRAMES, ""), (Lane.RESULTS, "")])


@settings(deadline=None)
@given(st.integers(1, 8), st.lists(st.one_of(st.none(), st.tuples(LANES, st.integers(1, 4))), max_size=60))
def test_every_sample_is_sent_once_or_counted_as_dropped(limit: int, steps: list) -> None:
    """``None`` takes a message, all else puts one of a lane; the account must agree with a model that only counts."""
    box, account = outbox(limit)
    following: Counter[str] = Counter()
    sent: dict[str, list[Mark]] = {}
    for step in [*steps, *[None] * limit]:
        if step is None:
            if len(box):
                outgoing = box.take()
                assert outgoing is not None
                box.sent(outgoing)
                sent.setdefault(outgoing.topic, []).append(outgoing.mark)
            continue
        (lane, source), count = step
        count = 1 if lane is Lane.RESULTS else count
        make = {Lane.RAW: lambda f, c, s=source: raw(f, c, s), Lane.FRAMES: frame, Lane.RESULTS: lambda f, _: result(f)}
        topic = {Lane.RAW: f"raw/{source}/samples", Lane.FRAMES: "frame", Lane.RESULTS: "alarm"}[lane]
        box.put(lane, make[lane](following[topic], count))
        following[topic] += count
        assert len(box) <= limit
        assert account.residue == 0
    marks = [m for topic in sent.values() for m in topic]
    assert account.received == sum(m.count for m in marks)
    assert account.received + account.dropped.total() == following.total()
    for topic in sent.values():
        assert all(a.end <= b.sequence for a, b in pairwise(topic))
