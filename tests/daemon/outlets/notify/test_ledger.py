"""The ledger on disk: what a crash, a full disk and a torn line leave of it; and the undelivered."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from cellwatt.outlets.notify import ledger as module
from cellwatt.outlets.notify import undelivered
from cellwatt.outlets.notify.ledger import Ledger
from cellwatt.outlets.notify.told import Due, Ended, Entry, Item, Made, Message, Seen
from tests.daemon.outlets.notify.cell import ABOUT, EPOCH, alarm

ITEM = Item("raised", alarm(1))
STORY: list[Entry] = [
    Due(ITEM, EPOCH),
    Due(Item("raised", alarm(2)), EPOCH),
    Made(Message("1f", EPOCH, (ITEM,))),
    Ended("1f", accepted=True),
    Seen(alarm(1), EPOCH + 1),
]


def read(path: Path) -> Ledger:
    found = Ledger(path)
    found.read()
    return found


async def write(path: Path, *entries: Entry) -> Ledger:
    made = read(path)
    for entry in entries:
        made.put("shift", entry)
        await made.flush()
    return made


async def test_what_is_read_is_what_was_known(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    for count in range(len(STORY) + 1):
        path.unlink(missing_ok=True)
        made = await write(path, *STORY[:count])
        await made.flush()
        assert read(path).told == made.told
        assert path.stat().st_mode & 0o777 == 0o600


async def test_any_torn_end_leaves_the_lines_before(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    await write(path, *STORY[:1])
    before = path.stat().st_size
    made = read(path)
    made._anew = False  # goes on in the file that is there
    made.put("shift", STORY[2])
    await made.flush()
    content = path.read_bytes()
    one = read(path).told if path.write_bytes(content[:before]) else {}
    for end in range(before + 1, len(content) - 1, 23):
        path.write_bytes(content[:end])
        found = read(path)
        assert found.told == one
        assert found.unreadable == 1
    await found.flush()  # written anew: what follows stands on a line of its own
    assert read(path).told == one
    assert read(path).unreadable == 0


async def test_strange_lines_are_counted_and_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    made = await write(path, *STORY[:2])
    path.write_bytes(b"\xff\n[]\n3\n" + path.read_bytes() + b'["shift",{"kind":"paid"}]\n[5,{}]\n{}\n')
    found = read(path)
    assert found.told == made.told
    assert found.unreadable == 6


async def test_stays_short(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    made = Ledger(path, largest=3000)
    sizes = []
    for number in range(200):
        made.put("shift", Made(Message(f"{number}", EPOCH, (ITEM,))))
        made.put("shift", Ended(f"{number}", accepted=True))
        await made.flush()
        sizes.append(path.stat().st_size)
    assert max(sizes) < 6000
    assert read(path).told == made.told


async def test_newer_figures_alone_are_not_written(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    made = await write(path, *STORY[:1])
    size = path.stat().st_size
    made.put("shift", Seen(alarm(1, statement="newer"), EPOCH))
    await made.flush()
    assert path.stat().st_size == size


async def test_a_full_disk_is_told_and_made_good_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "notify.jsonl"
    made = await write(path, STORY[0])

    def full(*_: Any) -> None:
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patch:
        patch.setattr(module, "append", full)
        patch.setattr(module, "replace_bytes", full)
        made.put("shift", STORY[1])
        await made.flush()
        made.put("shift", STORY[2])
        await made.flush()
    assert made.problem == f"{path} cannot be written, so a restart may send again: No space left on device"
    await made.flush()
    assert made.problem is None
    assert read(path).told == made.told


async def test_former_recipients_are_forgotten(tmp_path: Path) -> None:
    path = tmp_path / "notify.jsonl"
    made = await write(path, *STORY[:3])
    assert made.keep(["others"]) == {"shift": 2}
    await made.flush()
    assert path.read_bytes() == b""


def test_undelivered_files_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / undelivered.FILE
    line = undelivered.line(ABOUT, "shift", Message("1f", EPOCH, (ITEM,)), "550 no", "2026-11-24T10:00:00+00:00")
    thrown = [undelivered.keep(path, line, 3 * len(line)) for _ in range(10)]
    assert thrown == [False] * 6 + [True] + [False] * 2 + [True]
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == [undelivered.FILE, f"{undelivered.FILE}.1"]
    assert all(file.stat().st_mode & 0o777 == 0o600 for file in files)
    assert files[0].read_bytes() == line
    assert files[1].read_bytes() == 3 * line
    told = json.loads(line)
    assert (told["to"], told["reason"], told["alarms"][0]["id"]) == ("shift", "550 no", alarm(1).id)
