"""Alarms of the past: raise, clear and the word of people, whatever files and restarts lie between."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt.outlets.page.levels import episodes as past
from cellwatt.outlets.page.levels.curves import curves
from cellwatt.outlets.page.levels.episodes import alarm_history, episodes, read
from cellwatt.outlets.page.levels.store import Store
from cellwatt.record import packs
from tests.daemon.outlets.page.recorded import CELL, MS, SESSION, S, alarm, event, interval, recording

START = SESSION / MS


def at(second: float) -> int:
    return SESSION + round(second * S)


def ms(second: float) -> float:
    return at(second) / MS


def history(folder: Path, start: float = 0, end: float = 86_400, limit: int = 100) -> dict:
    return alarm_history(Store(folder, CELL), ms(start), ms(end), limit)


def test_an_alarm_is_told_from_raise_to_clear_over_several_files(tmp_path):
    recording(tmp_path, [[alarm("a", at(1), at(2), evidence={"power_W": 3.0})]], 1)
    recording(
        tmp_path, [[alarm("a", at(1), at(10), statement="worse", severity="warning"), interval(1, at(3), at(4))]], 2
    )
    recording(tmp_path, [[alarm("a", at(1), at(20), False, statement="gone")]], 3)
    (found,) = history(tmp_path)["alarms"]
    assert (found["since"], found["time"], found["cleared"]) == (ms(1), ms(10), ms(20))
    assert (found["statement"], found["cleared_statement"], found["severity"]) == ("worse", "gone", "warning")
    assert found["active"] is False and found["acknowledged"] is None and found["people"] == []
    assert found["evidence_page"] is None
    json.dumps(found, allow_nan=False)


def test_people_stand_beside_the_alarm_that_they_spoke_of(tmp_path):
    first = [
        alarm("a", at(1), at(1)),
        alarm("b", at(1), at(1)),
        event("acknowledged", at(2), alarm="a", name="Ada", note="seen"),
        event("shelved", at(3), alarm="a", name="Bo", note="until the part is here", until=at(3600)),
        event("connected", at(3), alarm="a", name="no person"),
        event("unshelved", at(4), alarm="a", name="Cy", note=""),
        alarm("a", at(1), at(5), False),
        alarm("a", at(6), at(6)),
        event("acknowledged", at(7), alarm="a", name="Di", note="again"),
    ]
    recording(tmp_path, [first])
    found = {(a["id"], a["since"]): a for a in history(tmp_path)["alarms"]}
    assert found["b", ms(1)]["people"] == []
    one, two = found["a", ms(1)], found["a", ms(6)]
    assert one["acknowledged"] == {"name": "Ada", "note": "seen", "time": ms(2)}
    assert one["people"] == [
        {"t": ms(2), "what": "acknowledged", "name": "Ada", "note": "seen"},
        {"t": ms(3), "what": "shelved", "name": "Bo", "note": "until the part is here", "until": ms(3600)},
        {"t": ms(4), "what": "unshelved", "name": "Cy", "note": ""},
    ]
    assert two["acknowledged"]["name"] == "Di" and len(two["people"]) == 1


def test_the_newest_of_the_span_come_first_and_the_rest_is_told_to_be_missing(tmp_path):
    recording(tmp_path, [[alarm(f"a{i}", at(i), at(i)) for i in range(10)]])
    found = history(tmp_path, limit=3)
    assert [a["id"] for a in found["alarms"]] == ["a9", "a8", "a7"] and not found["complete"]
    assert history(tmp_path, limit=10)["complete"]
    assert [a["id"] for a in history(tmp_path, 0, 2.5)["alarms"]] == ["a2", "a1", "a0"]


def test_an_alarm_whose_raise_is_gone_is_told_by_its_clear(tmp_path):
    recording(tmp_path, [[alarm("a", at(1), at(50), False, statement="gone")]])
    (found,) = history(tmp_path)["alarms"]
    assert (found["id"], found["since"], found["cleared"], found["active"]) == ("a", ms(1), ms(50), False)


def test_evidence_is_where_the_daemon_told_or_where_the_alarm_names_it(tmp_path):
    told, named, none = alarm("a", at(1), at(2)), alarm("b/c", at(1), at(3)), alarm("d", at(1), at(4))
    data = {"alarms": ["a", "x"], "pack": "weld-3_20260101T000000_000Z_x.mcap", "start": at(0), "end": at(60)}
    recording(
        tmp_path, [[told, named, none, event("evidence", at(65), **data), event("evidence", at(65), alarms=["d"])]]
    )
    (tmp_path / "evidence").mkdir()
    for pack in (data["pack"], packs.name_of(CELL, named) + ".mcap"):
        (tmp_path / "evidence" / pack).write_bytes(b"")
        packs.page_of(tmp_path / "evidence" / pack).write_text("page")
    found = {a["id"]: a["evidence_page"] for a in history(tmp_path)["alarms"]}
    assert found == {
        "a": "evidence/weld-3_20260101T000000_000Z_x.html",
        "b/c": "evidence/weld-3_20261121T095923_000Z_b-c.html",
        "d": None,
    }
    packs.page_of(tmp_path / "evidence" / data["pack"]).unlink()
    assert {a["id"]: a["evidence_page"] for a in history(tmp_path)["alarms"]}["a"] is None


def test_an_alarm_of_two_packs_has_its_own_each_time(tmp_path):
    items = [
        alarm("a", at(1), at(1)),
        alarm("a", at(1), at(5), False),
        event("evidence", at(62), alarms=["a"], pack="one.mcap", start=at(0), end=at(61)),
        alarm("a", at(300), at(300)),
        event("evidence", at(362), alarms=["a"], pack="two.mcap", start=at(180), end=at(361)),
    ]
    recording(tmp_path, [items])
    reader = Store(tmp_path, CELL)
    recordings = reader.recordings()
    said, _ = read(reader, recordings, 0, at(1000), int)
    assert [(e.raised, e.pack) for e in episodes(recordings, said)] == [(at(1), "one.mcap"), (at(300), "two.mcap")]


def test_what_takes_too_long_is_left_out_and_told(tmp_path, monkeypatch):
    recording(tmp_path, [[alarm("a", at(1), at(2))]])
    monkeypatch.setattr(past, "PATIENCE", -1.0)
    assert history(tmp_path) == {"alarms": [], "complete": False}


OPERATIONS = st.lists(
    st.tuples(
        st.sampled_from(["a", "b"]),
        st.sampled_from(["raise", "update", "update", "clear", "acknowledge", "file", "restart"]),
    ),
    min_size=1,
    max_size=40,
)


@settings(max_examples=30, deadline=None)
@given(OPERATIONS, st.booleans())
def test_any_history_is_told_as_it_was(operations, levels):
    files: list[tuple[int, int, list]] = [(SESSION, 1, [])]
    true: list[dict] = []
    up: dict[str, dict] = {}
    for second, (name, what) in enumerate(operations, 1):
        session, number, items = files[-1]
        here = up.get(name)
        if what == "raise" and here is None:
            up[name] = here = {"id": name, "since": ms(second), "cleared": None, "people": 0}
            true.append(here)
            items.append(alarm(name, at(second), at(second)))
        elif what == "update" and here is not None:
            items.append(alarm(name, round(here["since"] * MS), at(second)))
        elif what == "clear" and here is not None:
            here["cleared"] = ms(second)
            items.append(alarm(name, round(here["since"] * MS), at(second), False))
            del up[name]
        elif what == "acknowledge" and here is not None:
            here["people"] += 1
            items.append(event("acknowledged", at(second), alarm=name, name="Ada", note=""))
        elif what == "file":
            files.append((session, number + 1, []))
        elif what == "restart":
            files.append((at(second), 1, []))
            for over in up.values():
                over["cleared"] = ms(second)
            up.clear()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for session, number, items in files:
            chunk = [interval(number, session, session + 1), *items]
            recording(folder, [chunk], number, session)
        if levels:
            curves(Store(folder, CELL), [], START, START + 1e6, 10)
            assert list((folder / "levels").iterdir())
        found = history(folder)
    plain = [{k: a[k] for k in ("id", "since", "cleared")} | {"people": len(a["people"])} for a in found["alarms"]]
    assert sorted(plain, key=lambda a: (a["since"], a["id"])) == sorted(true, key=lambda a: (a["since"], a["id"]))
    assert found["complete"]
