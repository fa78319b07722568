import numpy as np
import pytest

from cellwatt.live import last_minute
from cellwatt.live.last_minute import SPAN, LastMinute

SECOND = 10**9


def add(kept: LastMinute, first: int, count: int, rate: float = 100.0, names: tuple[str, ...] = ("a", "b")) -> None:
    """Rows whose values say which they are: ``a`` counts up, ``b`` down."""
    rows = np.arange(first, first + count)
    values = np.column_stack([rows * (1 - 2 * i) for i in range(len(names))]).astype(float)
    kept.add(np.round(rows / rate * SECOND).astype(np.int64), names, ("1",) * len(names), values)


@pytest.mark.parametrize("block", [1, 7, 1000])
def test_the_last_minute_is_kept_however_it_came(block: int) -> None:
    kept = LastMinute()
    total = 20_000 // block * block
    for first in range(0, total, block):
        add(kept, first, block)
    rows = kept.within(SPAN)
    assert kept.of("a")[rows].tolist() == list(range(total - 6001, total))
    assert kept.of("b")[rows].tolist() == [-n for n in range(total - 6001, total)]
    assert (np.diff(kept.time) > 0).all()


def test_other_names_begin_anew() -> None:
    kept = LastMinute()
    add(kept, 0, 10)
    add(kept, 10, 5, names=("c",))
    assert kept.names == ("c",)
    assert kept.of("c").tolist() == [10, 11, 12, 13, 14]


def test_times_that_went_back_replace_what_was_later() -> None:
    kept = LastMinute()
    add(kept, 0, 10)
    add(kept, 4, 2)
    assert kept.of("a").tolist() == [0, 1, 2, 3, 4, 5]


def test_no_more_is_kept_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(last_minute, "_MOST", 2000)
    kept = LastMinute()
    for first in range(0, 50_000, 10):
        add(kept, first, 10)
        assert len(kept.time) <= 1000
    assert kept.of("a")[-1] == 49_999
    assert len(kept.time) >= 500
