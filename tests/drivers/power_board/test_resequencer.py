"""Order is restored, losses are told, and every packet has exactly one fate."""

from __future__ import annotations

from collections import Counter

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_drivers.power_board.resequencer import MOST_HELD, Placed, Resequencer
from tests.drivers.power_board.samples import packet

WINDOW = 40


def placed(number: int, arrival: int = 0, samples: int = 1) -> Placed:
    return Placed(packet(number, samples=samples), number, number * 8130, arrival)


def begun(window: int, *released: int) -> Resequencer:
    """After the packets of some numbers, by default only the first."""
    order = Resequencer(window)
    for number in released or (0,):
        order.put(placed(number))
        order.release(0)
    return order


def numbers(released: list[tuple[int, Placed]]) -> list[tuple[int, int]]:
    return [(gap, p.sequence) for gap, p in released]


def test_overtaken_packet_is_put_back() -> None:
    order = begun(WINDOW)
    assert order.put(placed(2, arrival=10)) == ""
    assert numbers(order.release(10)) == []
    assert order.deadline == 10 + WINDOW
    assert order.put(placed(1, arrival=20)) == "reordered"
    assert numbers(order.release(20)) == [(0, 1), (0, 2)]


def test_gap_is_given_up_in_time() -> None:
    order = begun(WINDOW)
    order.put(placed(3, arrival=10))
    order.put(placed(5, arrival=30))
    assert numbers(order.release(10 + WINDOW - 1)) == []
    assert numbers(order.release(10 + WINDOW)) == [(2, 3)]
    assert numbers(order.release(30 + WINDOW)) == [(1, 5)]


def test_what_comes_after_is_late_and_twice_is_a_duplicate() -> None:
    order = begun(0, 0, 3)
    assert order.put(placed(2)) == "late"
    assert order.put(placed(3)) == "duplicates"
    assert order.put(placed(0)) == "duplicates"


def test_what_waits_is_bounded() -> None:
    order = begun(10**9)
    for number in range(2, MOST_HELD + 2):
        order.put(placed(number))
        assert order.release(0) == []
    order.put(placed(MOST_HELD + 2))
    released = order.release(0)
    assert numbers(released)[0] == (1, 2)
    assert len(released) == MOST_HELD + 1
    assert order.deadline is None


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 30)), min_size=1, max_size=80), st.booleans())
def test_every_packet_has_one_fate(sent: list[tuple[int, int]], eager: bool) -> None:
    """Whatever comes in whatever order: released packets rise, and gaps and releases add up to the numbering."""
    order, now, fates = Resequencer(WINDOW), 0, Counter()
    first = sent[0][0]
    released: list[tuple[int, Placed]] = []
    for number, pause in sent:
        now += pause
        fates[order.put(placed(number, now))] += 1
        if eager:
            released += order.release(now)
    released += order.release(now, everything=True)
    order_of = [p.sequence for _, p in released]
    assert order_of == sorted(set(order_of))
    assert fates[""] + fates["reordered"] == len(released)
    assert sum(gap + 1 for gap, _ in released) == order_of[-1] - first + 1
