"""The ledger on disk: what a crash, a full disk and a torn line leave of it; and the undelivered."""

from __future__ import annotations

import json
from pathlib import Path

from cellwatt.files import put_aside
from cellwatt.outlets.notify.courier import UNDELIVERED
from cellwatt.outlets.notify.ledger import Ledger
from cellwatt.outlets.notify.rules import Item, Notification, Recipient
from cellwatt.outlets.notify.texts import undelivered
from tests.daemon.outlets.notify.cell import ABOUT, EPOCH, alarm

ITEM = Item("raised", alarm(1))


def read(path: Path) -> Ledger:
    found = Ledger(path)
    found.read()
    return found


async def write(path: Path) -> Ledger:
    """One of two alarms told, and the other on its way."""
    made = read(path)
    told = made.of("shift")
    for number in (1, 2):
        told.wait(Item("raised", alarm(number)), EPOCH)
    told.send(Notification("1f", EPOCH, (ITEM,)))
    await made.flush()
    return made


async def test_what_is_read_is_what_was_known(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    made = await write(path)
    assert read(path).states == made.states
    for change in (Recipient.arrived, lambda told: told.see(alarm(1), EPOCH + 1), lambda told: told.drop(alarm(2).id)):
        change(made.of("shift"))
        await made.flush()
        assert read(path).states == made.states
    assert path.stat().st_mode & 0o777 == 0o600


async def test_strange_lines_are_counted_and_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    made = await write(path)
    before = b'["shift",{"kind":"whole","episodes":[],"due":[],"flight":null,"ended":[],"more":0}]\n'
    path.write_bytes(b"\xff\n[]\n3\n" + before + path.read_bytes() + b"[5,{}]\n{}\n")
    found = read(path)
    assert found.states == made.states
    assert found.unreadable == 6
    await found.flush()
    assert read(path).unreadable == 0


def test_undelivered_files_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / UNDELIVERED
    line = undelivered(ABOUT, "shift", Notification("1f", EPOCH, (ITEM,)), "550 no", "2026-11-24T10:00:00+00:00")
    thrown = [put_aside(path, line, 3 * len(line)) for _ in range(10)]
    assert thrown == [False] * 6 + [True] + [False] * 2 + [True]
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == [UNDELIVERED, f"{UNDELIVERED}.1"]
    assert all(file.stat().st_mode & 0o777 == 0o600 for file in files)
    assert files[0].read_bytes() == line
    assert files[1].read_bytes() == 3 * line
    told = json.loads(line)
    assert (told["to"], told["reason"], told["alarms"][0]["id"]) == ("shift", "550 no", alarm(1).id)
