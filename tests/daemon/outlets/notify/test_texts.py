"""Words of messages."""

from __future__ import annotations

import json
import math
from zoneinfo import ZoneInfo

from hypothesis import given
from hypothesis import strategies as st

from cellwatt.outlets.notify import texts
from cellwatt.outlets.notify.rules import Item, Notification
from cellwatt.outlets.notify.texts import About, body, evidence, payload, subject
from tests.daemon.outlets.notify.cell import ABOUT, CELL, EPOCH, SITE, alarm

BERLIN = About(SITE, CELL, "https://weld-3.plant.example:8480/", ZoneInfo("Europe/Berlin"))


def of(*items: Item, more: int = 0) -> Notification:
    return Notification("1f", EPOCH, items, more)


def test_one_alarm() -> None:
    told = of(Item("raised", alarm(3, alternatives=(2, 4), evidence={"residual_Nm": 12.04, "cycles": 3})))
    assert subject(BERLIN, told) == "[plant-1/weld-3] error: Joint 3 is loaded 12 Nm more than it should be"
    assert body(BERLIN, told) == (
        "Joint 3 is loaded 12 Nm more than it should be\n"
        "\n"
        "severity: error\n"
        "since:    2027-01-15 08:00:00 UTC (09:00:00 CET)\n"
        "joint:    3 of arm\n"
        "or:       joint 2, 4, which explains the evidence as well\n"
        "evidence: residual 12.04 Nm, cycles 3\n"
        "alarm:    faults.arm.joint_fault.3\n"
        "\n"
        "https://weld-3.plant.example:8480/cell/plant-1/weld-3/alarms\n"
    )


def test_several_begin_with_the_gravest() -> None:
    items = [
        Item("cleared", alarm(1, active=False)),
        Item("raised", alarm(2, severity="info")),
        Item("graver", alarm(3)),
        Item("repeated", alarm(4, severity="warning")),
    ]
    told = of(*items, more=7)
    assert subject(ABOUT, told) == (
        "[plant-1/weld-3] now error: Joint 3 is loaded 12 Nm more than it should be (and 10 more)"
    )
    lines = body(About(SITE, CELL, zone=ZoneInfo("UTC")), told).splitlines()
    assert lines[0] == "11 alarms:"
    assert [line.split(":")[0] for line in lines[2:6]] == ["- now error", "- still warning", "- info", "- over"]
    assert lines[6] == "and 7 more"
    assert texts.severity(told) == "error"
    assert texts.severity(of(items[0])) is None


def test_a_long_list_is_cut_for_a_telephone_and_says_by_how_much() -> None:
    items = [Item("raised", alarm(n, statement="Ü" * 100)) for n in range(100)]
    text = body(BERLIN, of(*items, more=5), 3800)
    listed = text.count("\n- ")
    assert len(text.encode()) <= 3800
    assert 5 < listed < 100
    assert f"and {105 - listed} more\n" in text
    assert text.endswith("/alarms\n")
    assert body(BERLIN, of(*items, more=5)).count("\n- ") == 100


def test_units_of_evidence() -> None:
    given = {"residual_W": 38.0, "cpu_percent": 97.5, "behind_s": 4, "part": "left", "ok": True, "list": [1], "W": 2.0}
    assert list(evidence(given)) == ["residual 38 W", "cpu 97.5 %", "behind 4 s", "part left", "W 2"]
    assert len(list(evidence({f"figure_{n}": n for n in range(50)}))) == texts.FIGURES


def test_for_programs_it_is_valid_json_whatever_the_figures() -> None:
    told = of(Item("raised", alarm(1, evidence={"a": math.nan, "b": [math.inf, 1.5], "c": {"d": -math.inf}})))
    text = json.dumps(payload(ABOUT, told), allow_nan=False)
    assert json.loads(text)["alarms"][0]["evidence"] == {"a": None, "b": [None, 1.5], "c": {"d": None}}
    assert json.loads(text)["alarms"][0]["happened"] == "raised"


@given(st.text(), st.text(), st.integers(300, 4000), st.integers(1, 5))
def test_no_text_breaks_its_line_or_its_limit(statement: str, alarm_id: str, limit: int, count: int) -> None:
    told = of(*(Item("raised", alarm(n, statement=statement, id=f"{n}{alarm_id}")) for n in range(count)))
    line = subject(ABOUT, told)
    assert line.isprintable()
    assert len(line) <= texts.LONGEST_SUBJECT
    text = body(ABOUT, told, limit)
    assert len(text.encode()) <= limit
    assert all(part.isprintable() for part in text.split("\n"))
