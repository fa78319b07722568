import numpy as np
import pytest

from cellwatt.live import last_minute
from cellwatt.live.last_minute import LastMinute

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
    assert kept.values[:, 0][-6001:].tolist() == list(range(total - 6001, total))
    assert kept.values[:, 1][-6001:].tolist() == [-n for n in range(total - 6001, total)]
    assert (np.diff(kept.time) > 0).all() and len(kept.time) < 6001 + block


def test_other_names_begin_anew_and_times_that_went_back_replace_what_was_later() -> None:
    kept = LastMinute()
    add(kept, 0, 10)
    add(kept, 10, 5, names=("c",))
    assert (kept.names, kept.values[:, 0].tolist()) == (("c",), [10, 11, 12, 13, 14])
    add(kept, 12, 1, names=("c",))
    assert kept.values[:, 0].tolist() == [10, 11, 12]
    add(kept, 2, 1, names=("c",))
    assert kept.values[:, 0].tolist() == [2]


def test_no_more_is_kept_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(last_minute, "_MOST", 2000)
    kept = LastMinute()
    for first in range(0, 50_000, 10):
        add(kept, first, 10)
    assert kept.values[:, 0].tolist() == list(range(49_000, 50_000))
