"""The account of rows, against a set of times."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.account import Account
from cellwatt.outlets.mqtt.books import Books
from cellwatt.outlets.mqtt.ledger import MOST, Ledger, dump, load

STEP = 10
DO = st.lists(st.sampled_from(["send", "miss", "restart", "fill", "owe"]), max_size=60)


def lacking(ledger: Ledger, made: int) -> set[int]:
    """Times of rows that the ledger knows to be missing: in gaps, or after all that was delivered."""
    gaps = {t for after, until in ledger.gaps for t in range(STEP, made + 1, STEP) if after < t <= until}
    return gaps | {t for t in range(STEP, made + 1, STEP) if ledger.reached is not None and t > ledger.reached}


@given(DO)
def test_a_row_is_delivered_or_known_to_be_missing(steps: list[str]) -> None:
    ledger, made, missing, last = Ledger(), 0, set[int](), None
    for step in steps:
        if step in ("send", "miss"):
            made += STEP
            before = made - STEP if last is None else last
            last = made
            if step == "send":
                ledger.delivered(made, before)
            elif ledger.reached is not None:
                missing.add(made)
            else:
                continue  # nothing was ever delivered: what was before is nobody's
        elif step == "restart":
            ledger, last = Ledger.model_validate_json(dump(ledger)), None
        elif step == "owe" and last is not None:
            if ledger.reached is None:
                ledger.owe(last)
            else:
                ledger.owe(last)
        elif step == "fill" and ledger.gaps:
            after, until = ledger.gaps[0]
            ledger.filled(after + STEP, until)
            missing.discard(after + STEP)
        assert lacking(ledger, made) == missing
        assert ledger.gaps == sorted(ledger.gaps) and all(a < u for a, u in ledger.gaps)


def test_the_oldest_of_too_many_gaps_is_given_up_and_counted(tmp_path: Path) -> None:
    books = Books(tmp_path / "positions.json", account := Account())
    for i in range(1, MOST + 4):
        books.delivered(20 * i, 20 * i - 10)
    assert len(books.ledger.gaps) == MOST and account.counters["spans given up"] == 2


def test_filling_one_gap_leaves_another_alone() -> None:
    ledger = Ledger(reached=100, gaps=[(10, 20), (30, 50)])
    ledger.filled(40, 50)
    assert ledger.gaps == [(10, 20), (40, 50)]
    ledger.filled(60, 50)
    ledger.filled(15, 999)
    assert ledger.gaps == [(10, 20)]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"gaps": 5}', '{"births": 300}', '{"reached": "x"}'])
def test_a_damaged_file_is_told_and_a_new_account_begun(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "positions.json"
    path.write_text(text)
    assert load(path) == Ledger()
    assert "it is damaged" in caplog.text
    assert load(tmp_path / "none.json") == Ledger()


async def test_the_file_follows_and_a_folder_that_refuses_is_told(tmp_path: Path) -> None:
    books = Books(tmp_path / "positions.json", Account())
    await books.open()
    keeping = asyncio.create_task(books.keep())
    for i in range(50):
        books.delivered(10 * i, 10 * i - 10)
        await asyncio.sleep(0)
    keeping.cancel()
    await asyncio.wait([keeping])
    await books.write()
    text = await asyncio.to_thread((tmp_path / "positions.json").read_text)
    assert json.loads(text)["reached"] == 490
    gone = Books(tmp_path / "gone" / "positions.json", account := Account())
    await gone.write()
    assert gone.problem is not None and "No such file" in gone.problem and account.counters["positions unwritten"] == 1
