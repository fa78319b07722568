"""Evidence packs as files: names, notes of what is due, budget and age."""

import os
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt import Alarm
from cellwatt.record import packs
from cellwatt.record.header import FileName
from cellwatt.record.packs import Due, listing, name_of, retain, wants
from cellwatt.record.settings import EvidenceSettings
from tests.daemon.record.making import CELL, SESSION

S = 10**9
SETTINGS = EvidenceSettings(before=120.0, after=60.0)


def alarm(name: str = "faults.arm.joint_fault.2", at: float = 0.0, since: float | None = None, **more) -> Alarm:
    time, begun = (SESSION + round(t * S) for t in (at, at if since is None else since))
    told = {"kind": "joint_fault", "severity": "error", "active": True, "statement": "Joint 2", **more}
    return Alarm(id=name, since=begun, time=time, **told)


@given(st.text(max_size=400))
def test_whatever_an_id_holds_the_name_is_one_file_of_the_folder(text):
    name = name_of(CELL, alarm(text))
    assert re.fullmatch(r"weld-3_20261121T095923_290Z_[A-Za-z0-9_.-]{1,80}", name)
    assert FileName.parse(f"{name}.mcap") is None, "is no file of the record"


@pytest.mark.parametrize(
    ("since", "start"),
    [(0.0, -120.0), (-50.0, -170.0), (-120.0, -240.0), (-5000.0, -240.0)],
    ids=["at once", "evidence of before", "as long before", "evidence of long ago"],
)
def test_the_span_begins_before_the_first_evidence(since, start):
    due = Due.of(CELL, alarm(since=since), SETTINGS)
    assert (due.start, due.end) == (SESSION + round(start * S), SESSION + 60 * S)


def test_a_storm_of_alarms_shares_a_pack_until_it_is_long_enough():
    due, made = Due.of(CELL, alarm("a"), SETTINGS), 1
    for second in range(1, 600):
        one = alarm(f"a{second}", at=second)
        joined = due.joined(one, SETTINGS)
        made += joined is None
        due = joined or Due.of(CELL, one, SETTINGS)
        assert due.end - due.start <= 300 * S
        assert due.end >= one.time + 60 * S, "every alarm has its time after"
        assert len(due.alarms) <= 100
    # A new one every 121 s: the first takes alarms of 0 to 120 s.
    assert made == 5
    assert len(due.alarms) + due.more == 600 - 4 * 121


@pytest.mark.parametrize(
    ("least", "severity", "wanted"),
    [("warning", "info", False), ("warning", "warning", True), ("error", "warning", False), ("none", "error", False)],
)
def test_which_alarms_want_a_pack(least, severity, wanted):
    settings = EvidenceSettings(severity=least)
    assert wants(settings, alarm(severity=severity)) is wanted
    assert not wants(settings, alarm(severity=severity, active=False))


def test_what_is_due_outlives_the_process_and_a_note_that_names_a_place_outside_is_refused(tmp_path):
    folder = tmp_path / packs.FOLDER
    evidence = {"power_residual_W": 38.0, "task": "task_1", "flag": True}
    due = [Due.of(CELL, alarm(at=t, evidence=evidence, alternatives=(3,)), SETTINGS) for t in (0, 200)]
    for one in reversed(due):
        packs.write_due(folder, one)
    packs.write_due(folder, replace(due[0], name="paint-1_x", cell="paint-1"))
    (folder / f"broken{packs.DUE}").write_text('{"name": "../../etc"')
    assert packs.all_due(folder, CELL) == due
    assert not (folder / f"broken{packs.DUE}").exists()
    assert packs.all_due(tmp_path / "none", CELL) == []
    path, name = packs.due_path(folder, due[0]), due[0].name.encode()
    path.write_bytes(path.read_bytes().replace(name, b"../" + name))
    assert packs.all_due(folder, CELL) == due[1:] and not path.exists()


def made(folder, n, size=1000, age=0.0):
    path = folder / f"{name_of(CELL, alarm(at=n))}.mcap"
    path.write_bytes(b"x" * size)
    path.with_suffix(".html").write_bytes(b"y" * size)
    os.utime(path, (2e9 - age, 2e9 - age))
    return path


def test_budget_and_age_of_packs_count_what_stands_beside_them(tmp_path):
    paths = [made(tmp_path, n, age=100.0 * (5 - n)) for n in range(5)]
    (tmp_path / "notes.mcap").write_bytes(b"not ours")
    assert [p.size for p in listing(tmp_path, CELL)] == [2000] * 5
    kept = retain(tmp_path, CELL, EvidenceSettings(keep=6500.0, age=0.0), 2e9)
    assert [p.path for p in kept] == paths[2:]
    kept = retain(tmp_path, CELL, EvidenceSettings(keep=1e6, age=150.0), 2e9)
    assert [p.path for p in kept] == paths[4:]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        ["notes.mcap", *(paths[4].name.replace(".mcap", end) for end in (".mcap", ".html"))]
    )
