import os
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.record import RecordSettings, folder, survey
from cellwatt.record.folder import RecordFile, listing, surplus
from cellwatt.record.header import PART, FileName
from cellwatt.record.upkeep import Upkeep

from .making import CELL, SESSION, name_of

NOW = 2e9


def kept(number, size, *, age=0.0, closed=True):
    return RecordFile(Path(f"{number}"), size, NOW - age, closed, FileName(SESSION, number, CELL))


def numbers(files):
    return [f.name.number for f in files]


def test_old_files_go_whatever_the_budget_but_not_those_of_a_pc_without_a_clock():
    files = [kept(1, 1, age=500), kept(2, 1, age=99), kept(3, 1, age=101), kept(4, 1, age=NOW - 3600)]
    assert numbers(surplus(files, keep=1e9, age=100, now=NOW, reserve=0)) == [1, 3]
    assert numbers(surplus(files, keep=1e9, age=0, now=NOW, reserve=0)) == []


@given(
    st.lists(st.tuples(st.integers(0, 1000), st.booleans()), max_size=20), st.integers(0, 10_000), st.integers(0, 500)
)
def test_no_more_goes_than_must(sizes, keep, reserve):
    files = [kept(n, size, closed=closed) for n, (size, closed) in enumerate(sizes)]
    gone = surplus(files, keep=keep, age=0, now=NOW, reserve=reserve)
    left = sum(f.size for f in files) + reserve - sum(f.size for f in gone)
    closed = [f for f in files if f.closed]
    assert gone == closed[: len(gone)]
    assert left <= keep or gone == closed
    assert not gone or left + gone[-1].size > keep


def test_only_this_cells_files_are_listed(tmp_path):
    ours = [name_of(2), name_of(1), name_of(3) + ".part", name_of(1) + ".damaged", name_of(1) + ".2.damaged"]
    others = ["notes.txt", "weld-3.mcap", name_of(1).replace(CELL, "weld-33"), name_of(1) + ".bak", "." + name_of(4)]
    for name in (*ours, *others):
        (tmp_path / name).write_bytes(b"x")
    files = listing(tmp_path, CELL)
    assert {f.path.name for f in files} == set(ours)
    assert [f.name.number for f in files] == [1, 1, 1, 2, 3]
    assert [f.path.name for f in files if not f.closed] == [name_of(3) + ".part"]
    assert listing(tmp_path / "absent", CELL) == []


def test_a_file_that_is_closed_while_the_folder_is_listed_is_listed_once(tmp_path, monkeypatch):
    """The system may pass over a file that is renamed during the listing, and the file may lose its name after it."""
    first, part = tmp_path / name_of(1), tmp_path / (name_of(2) + PART)
    closed, listed = tmp_path / name_of(2), survey._listed
    first.write_bytes(b"x")
    part.write_bytes(b"xx")
    passed_over = iter([[first.name]])
    monkeypatch.setattr(survey, "_listed", lambda within: next(passed_over, None) or listed(within))
    assert [f.path for f in listing(tmp_path, CELL)] == [first, part]

    def closed_after(within):
        names = survey.names_in(within)
        part.rename(closed)
        return names

    monkeypatch.setattr(folder, "names_in", closed_after)
    assert [(f.path, f.size, f.closed) for f in listing(tmp_path, CELL)] == [(first, 1, True), (closed, 2, True)]


def test_a_clock_that_leaps_ahead_makes_no_recording_old(tmp_path, monkeypatch):
    now, day = time.time_ns(), 86400
    fresh, old = (tmp_path / str(FileName(now, number, CELL)) for number in (1, 2))
    for path, days in ((fresh, 29), (old, 31)):
        path.write_bytes(bytes(10))
        os.utime(path, (now / 1e9 - days * day,) * 2)
    monkeypatch.setattr("cellwatt.record.upkeep.time.time", lambda: now / 1e9 + 40 * day)
    upkeep = Upkeep(RecordSettings(folder=tmp_path, age=30.0 * day), CELL, now - 90 * day * 10**9, lambda: now)
    upkeep.retain()
    upkeep.close()
    assert fresh.exists() and not old.exists()


@pytest.mark.parametrize("session", [SESSION, SESSION + 10**12, SESSION - 10**12])
def test_a_new_start_keeps_to_the_budget(tmp_path, session):
    """Also after the PC's clock was set back: what was recorded since is not taken for the oldest."""
    before, now = (str(FileName(each, 1, CELL)) for each in (SESSION, session))
    names = [name.replace("_000001", f"_{n:06d}") for n, name in enumerate([before, before, now, now, now], start=1)]
    for name in names:
        (tmp_path / name).write_bytes(bytes(1000))
    upkeep = Upkeep(RecordSettings(folder=tmp_path, keep=4000.0, file_size=1e9), CELL, session, time.time_ns)
    upkeep.start()
    upkeep.close()
    # A quarter of the budget is left to the file that will be written.
    assert {p.name for p in tmp_path.iterdir()} == set(names[2:])
    assert upkeep.stats()["removed"] == {"files": 2, "bytes": 2000}


def test_names_tell_session_and_number():
    name = FileName(SESSION, 12, "weld 3/a")
    assert str(name) == "weld-3-a_20261121T095923_290084047Z_000012.mcap"
    assert FileName.parse(str(name)) == FileName(SESSION, 12, "weld-3-a")
    assert FileName.parse(str(name) + ".part") == FileName.parse(str(name))
    assert FileName.parse("weld_20261399T095923_290084047Z_000012.mcap") is None
