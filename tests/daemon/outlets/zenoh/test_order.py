from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt.outlets.zenoh.order import Follower, Gap, Part
from tests.daemon.outlets.zenoh.fake_cell import batch


def part(first: int, count: int, session: int = 1, backfilled: bool = False) -> Part:
    return Part(session, first, count, backfilled, batch(first, count))


def spans(parts: list[Part]) -> list[tuple[int, int, int]]:
    return [(p.session, p.sequence, p.end) for p in parts]


def test_overlap_is_cut_off_with_its_values() -> None:
    follower = Follower(1, 0)
    follower.take(part(0, 4))
    (fresh,) = follower.take(part(2, 5))
    assert spans([fresh]) == [(1, 4, 7)]
    assert fresh.content.values[:, 0].tolist() == [4, 5, 6]  # type: ignore[union-attr]
    assert follower.take(part(0, 7)) == []
    assert follower.duplicates == 2 + 7


def test_what_is_announced_is_missing_until_it_comes() -> None:
    follower = Follower(1, 5)
    follower.announce(1, 5)
    assert follower.hole() is None
    follower.announce(1, 8)
    hole = follower.hole()
    assert hole is not None
    assert (hole.first, hole.count, hole.certain) == (5, 3, False)
    follower.take(part(5, 3))
    assert follower.hole() is None


def test_what_the_cell_no_longer_has_becomes_a_gap() -> None:
    follower = Follower(1, 0)
    follower.take(part(10, 2))
    gap, rest, held = follower.fill(part(6, 4, backfilled=True))
    assert isinstance(gap.content, Gap)
    assert (gap.sequence, gap.count, gap.content.count) == (0, 6, 6)
    assert spans([rest, held]) == [(1, 6, 10), (1, 10, 12)]


def test_giving_up_a_hole_goes_on_behind_it() -> None:
    follower = Follower(1, 0)
    follower.take(part(4, 2))
    hole = follower.hole()
    assert hole is not None
    gap, rest = follower.give_up(hole, "gone")
    assert gap.content == Gap(4, "gone")
    assert spans([rest]) == [(1, 4, 6)]
    assert follower.give_up(hole, "late") == []


def test_a_session_may_have_a_lower_number_where_the_clock_was_set_back() -> None:
    follower = Follower(100, 3)
    follower.take(part(0, 1, session=50))
    tail = follower.hole()
    assert tail is not None
    assert spans(follower.give_up(tail, "")) == [(50, 0, 1)]
    assert follower.take(part(3, 1, session=100)) == []
    assert follower.hole() is None


def test_sessions_in_between_come_before_the_newest() -> None:
    follower = Follower(1, 3)
    follower.announce(6, 0)
    follower.take(part(0, 1, session=9))
    follower.between([1, 4, 6, 7, 9])
    assert follower.newest == 9
    order = []
    while (hole := follower.hole()) is not None:
        order.append((hole.session, hole.first, hole.count))
        follower.give_up(hole, "nothing")
    assert order == [(1, 3, None), (4, 0, None), (6, 0, None), (7, 0, None)]
    assert (follower.session, follower.following) == (9, 1)


@settings(deadline=None)
@given(st.data())
def test_whatever_comes_each_sample_is_given_once_in_order(data: st.DataObject) -> None:
    """Parts of two sessions arrive lost, doubled, shuffled and overlapping; holes are answered from a whole record."""
    lengths = {1: data.draw(st.integers(1, 30)), 2: data.draw(st.integers(1, 30))}
    follower = Follower(1, 0, hold=data.draw(st.integers(1, 6)))
    given_out: list[Part] = []
    for session, length in lengths.items():
        if session == 2:
            given_out += follower.take(part(length - 1, 1, session=2))
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
    assert [(p.session, n) for p in given_out for n in range(p.sequence, p.end)] == expected
    values = [v for p in given_out for v in p.content.values[:, 0]]  # type: ignore[union-attr]
    assert values == [n for _, n in expected]
