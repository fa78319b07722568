"""What a peer is owed, against a set of moments: any order of deliveries, cuts, kills, fills and clock steps."""

from __future__ import annotations

import os
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt import Account
from cellwatt.outlets.cursor import GONE, MOST, Cursor, load

STEP = 10
STEPS = st.lists(st.sampled_from(["send", "miss", "kill", "fill", "fill badly", "retain", "set back"]), max_size=60)


def spans(cursor: Cursor) -> list[tuple[int, int]]:
    return [(owed.after, owed.until) for owed in cursor.position.gaps]


@given(STEPS)
def test_what_was_made_is_delivered_owed_or_lost(steps: list[str]) -> None:
    """The record has every moment that retention has not taken; the file is as old as the last kill, or now."""
    made, there, kept = 0, set[int](), set[int]()
    account = Account()
    cursor = Cursor(None, account)

    def owed() -> set[int]:
        reached = cursor.position.reached or 0
        within = {t for after, until in spans(cursor) for t in range(STEP, made + 1, STEP) if after < t <= until}
        return within | {t for t in range(STEP, made + 1, STEP) if t > reached}

    cursor.deliver(0)
    for step in steps:
        match step:
            case "send" | "miss":
                made += STEP
                kept.add(made)
                account.expect()
                if step == "miss":
                    cursor.owe(made - STEP, made, 1)
                    continue
                cursor.deliver(made)
                account.receive()
                there.add(made)
            case "kill":  # what is in the file is known, the rest is in the record
                cursor.owe_since(made)
                known = cursor.position.model_copy()
                again = Cursor(None, Account())
                again.succeed(cursor)
                account, cursor = again._account, again
                assert known == cursor.position and account.expected == account.owed == cursor.entries
            case "fill" | "fill badly" if cursor.first is not None:
                after, until = cursor.first
                until = until if step == "fill" else min(after + STEP, until)
                found = {t for t in kept if after < t <= until}
                account.receive(len(found))
                cursor.pay(after, until, len(found))
                there |= found
            case "retain":
                kept -= {t for t in kept if t <= made // 2}
            case "set back":  # the clock of the host: cell time never goes back, an old position changes nothing
                cursor.deliver((cursor.position.reached or 0) // 2)
        lost = set(range(STEP, made + 1, STEP)) - kept
        assert set(range(STEP, made + 1, STEP)) <= there | owed() | lost
        assert account.residue == 0
        assert all(a[1] < b[0] for a, b in pairwise(spans(cursor))) and all(a < u for a, u in spans(cursor))


def test_spans_stay_few_and_nothing_is_forgotten() -> None:
    cursor = Cursor(None, account := Account())
    for n in range(MOST + 50):
        account.expect()
        cursor.owe(10 * n, 10 * n + 1, 1)
    assert len(spans(cursor)) == MOST and cursor.entries == account.owed == MOST + 50
    assert all(any(a < 10 * n + 1 <= u for a, u in spans(cursor)) for n in range(MOST + 50))
    assert account.residue == 0


def test_what_retention_passed_by_is_lost_and_counted() -> None:
    cursor = Cursor(None, account := Account())
    account.expect(7)
    cursor.owe(0, 70, 7)
    account.receive(4)
    cursor.pay(0, 70, 4)
    assert (account.missed, account.residue, cursor.position.lost, spans(cursor)) == (Counter({GONE: 3}), 0, 3, [])


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"gaps": 5}', '{"births": 300}', '{"reached": "x"}', '{"gaps": [[1]]}']
)
def test_a_damaged_file_is_told_and_begun_anew(tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "cell.peer.json"
    path.write_text(text)
    assert load(path).reached is None
    assert "its content is not valid" in caplog.text
    assert load(tmp_path / "none.json").gaps == []


async def test_spans_owed_before_the_file_is_read_stay_owed(tmp_path: Path) -> None:
    (tmp_path / "cell.peer.json").write_text('{"reached": 9, "gaps": [[1, 5, 0]], "births": 3}')
    cursor = Cursor(tmp_path / "cell.peer.json", Account())
    cursor.owe(20, 30, 2)  # offered before the file was read
    await cursor.open()
    assert (cursor.position.reached, spans(cursor), cursor.entries) == (9, [(1, 5), (20, 30)], 2)
    assert cursor.lacking.is_set()


async def test_another_place_is_owed_nothing_of_this_one(tmp_path: Path) -> None:
    cursor = Cursor(tmp_path / "c.json", Account(), "here")
    cursor.owe(1, 2)
    await cursor.write()
    assert not (tmp_path / "c.json").exists(), "nothing is written over what was not read"
    await cursor.open()
    await cursor.write()
    assert load(tmp_path / "c.json", "here").gaps == [(1, 2, 0)]
    assert load(tmp_path / "c.json", "there").gaps == []


async def test_a_full_disk_is_told_and_made_good_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cursor = Cursor(tmp_path / "c.json", account := Account())
    await cursor.open()
    cursor.deliver(5)
    await cursor.write()

    def full(*_: Any) -> None:
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        cursor.deliver(6)
        await cursor.write()
        assert "No space left on device" in str(cursor.problem) and account.counters["positions unwritten"] == 1
        assert load(tmp_path / "c.json").reached == 5
    await cursor.write()
    assert cursor.problem is None and load(tmp_path / "c.json").reached == 6
