"""Reports behind the page: listed, served under their own names alone, and the figures of the newest comparison."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from cellwatt import report
from cellwatt.outlets.page.reports import list_reports, newest_mismatch, report_file
from cellwatt_plugins.explain.report import figures
from cellwatt_plugins.explain.report import page as explain_page
from cellwatt_plugins.explain.verdict.findings import ChannelFit, Findings
from tests.plugins.explain.reported import STANDBY, STRIBECK


@pytest.fixture(autouse=True, scope="module")
def _without_curves() -> Iterator[None]:
    """No recording stands behind these pages."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "sections", lambda *_: [])
        yield


def write(path: Path, kind: str = "energy", finding: str = "All is well.", day: int = 1, tone: Any = "good") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    origin = report.Provenance({}, "", {}, datetime(2026, 3, day, 8, 30, tzinfo=UTC))
    report.Report("weld-3", kind, ["2 recordings", "30 s"], finding, [], tone, provenance=origin).write(path)
    return path


def names(found: dict) -> list[str]:
    return [entry["path"] for entry in found["reports"]]


# lists ----------------------------------------------------------------------------------------------


def test_reports_are_listed_newest_first_with_what_they_found(tmp_path):
    write(tmp_path / "old.html", day=1)
    write(tmp_path / "evidence" / "an alarm & more.html", "evidence of an alarm", "Joint 2 <drags>.", 3, "open")
    write(tmp_path / "middle.html", day=2)
    found = list_reports([tmp_path])
    assert names(found) == ["evidence/an alarm & more.html", "middle.html", "old.html"]
    assert found["reports"][0] == {
        "path": "evidence/an alarm & more.html",
        "kind": "evidence of an alarm",
        "name": "weld-3",
        "finding": "Joint 2 <drags>.",
        "tone": "open",
        "about": "2 recordings · 30 s",
        "made": "2026-03-03T08:30:00+00:00",
    }
    assert found["broken"] == []


def test_what_is_no_page_of_ours_is_passed_over_and_what_is_broken_is_told(tmp_path):
    (tmp_path / "manual.html").write_text("<html>a manual</html>")
    (tmp_path / "notes.txt").write_text("notes")
    whole = write(tmp_path / "cut.html")
    whole.write_text(whole.read_text()[:-50])
    os.mkfifo(tmp_path / "pipe.html")
    (tmp_path / "loop.html").symlink_to("loop.html")
    (tmp_path / "folder.html").mkdir()
    found = list_reports([tmp_path, tmp_path / "nowhere"])
    assert found["reports"] == []
    assert any("cut.html" in line and "ends too early" in line for line in found["broken"])
    assert any("pipe.html" in line and "FIFO" in line for line in found["broken"])
    for name in ("manual.html", "cut.html", "pipe.html", "loop.html", "folder.html", "notes.txt"):
        assert report_file([tmp_path], name) is None


def test_every_listed_report_is_found_under_its_path_and_only_once(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    files = [
        write(one / "report.html", day=1),
        write(two / "report.html", day=2),
        write(two / "deep" / "a.html", day=3),
    ]
    (two / "again.html").symlink_to(two / "report.html")
    folders = [one, two, one]
    listed = list_reports(folders)["reports"]
    assert len(listed) == 3
    assert {report_file(folders, entry["path"]).resolve() for entry in listed} == {f.resolve() for f in files}


def test_a_page_made_anew_is_read_anew(tmp_path):
    path = write(tmp_path / "a.html", finding="First.")
    assert list_reports([tmp_path])["reports"][0]["finding"] == "First."
    write(path, finding="Second, longer.")
    assert list_reports([tmp_path])["reports"][0]["finding"] == "Second, longer."


# no way out -----------------------------------------------------------------------------------------


def test_nothing_outside_is_listed_or_served(tmp_path):
    folder = tmp_path / "reports"
    write(tmp_path / "secret" / "secret.html")
    write(folder / "mine.html")
    (folder / "link.html").symlink_to(tmp_path / "secret" / "secret.html")
    (folder / "way").symlink_to(tmp_path / "secret")
    assert names(list_reports([folder])) == ["mine.html"]
    assert report_file([folder], "mine.html") == folder / "mine.html"
    outside = ("../secret/secret.html", "x/../../secret/secret.html", "/etc/passwd", "link.html", "way/secret.html")
    for path in (*outside, "~1/mine.html", "~0/mine.html", "~¹/mine.html", f"~{'9' * 20}/mine.html", "mine.html\0", ""):
        assert report_file([folder], path) is None


# mismatch -------------------------------------------------------------------------------------------

FIT = (
    ChannelFit("supply.power", "W", 41.0, 40.0, 4.2, 4.0),
    ChannelFit("joint_2.torque", "Nm", 9.0, 8.0, 0.7, 0.6),
    ChannelFit("joint_3.torque", "Nm", float("nan"), 2.0, 2.0, 0.6),
)
FINDINGS = Findings("partly_explained", (STRIBECK, STANDBY), fit=FIT)


def explained(folder: Path, findings: Findings | None = FINDINGS, day: int = 5) -> Path:
    """What ``cellwatt explain`` writes."""
    folder.mkdir(parents=True, exist_ok=True)
    origin = report.Provenance({}, "", {}, datetime(2026, 3, day, tzinfo=UTC))
    explain_page.report(findings or FINDINGS, [], "mh12", {}, origin).write(folder / "report.html")
    if findings is not None:
        (folder / "findings.json").write_text(json.dumps(findings.as_json(), indent=1))
    return folder / "report.html"


def test_the_newest_comparison_tells_before_and_after(tmp_path):
    write(tmp_path / "energy.html", day=9)
    assert newest_mismatch([tmp_path]) == {"finding": None}
    explained(tmp_path / "old", Findings("no_mismatch", ()), day=2)
    explained(tmp_path / "new", day=5)
    found = newest_mismatch([tmp_path])
    assert found["path"] == "new/report.html" and found["tone"] == "part" and found["finding"]
    assert (found["channel"], found["before"], found["after"], found["unit"]) == ("joint_2.torque", 9.0, 0.7, "Nm")
    assert [(e["effect"], e["joint"], e["before"], e["after"], e["unit"]) for e in found["effects"]] == [
        ("standby_power", None, 25.3, 4.02, "W"),
        ("stribeck_friction", 2, 2.51, 0.63, "N*m"),
    ]
    assert report_file([tmp_path], found["path"]) == tmp_path / "new" / "report.html"


@pytest.mark.parametrize("text", [None, "no json", "[" * 100_000, '{"fit": [{"channel": 3}]}'])
def test_a_page_without_its_figures_is_told_without_them(tmp_path, text):
    explained(tmp_path, None)
    if text is not None:
        (tmp_path / "findings.json").write_text(text)
    found = newest_mismatch([tmp_path])
    assert found["finding"] and found["path"] == "report.html"
    assert (found["before"], found["after"], found["unit"], found["effects"]) == (None, None, None, [])


def test_figures_of_an_earlier_version_are_told_as_far_as_they_go(tmp_path):
    explained(tmp_path, None)
    fit = {"channel": "joint_2.torque", "unit": "Nm", "simulation": 9.0, "model": 0.7}
    (tmp_path / "findings.json").write_text(json.dumps({"fit": [fit]}))
    assert newest_mismatch([tmp_path])["before"] == 9.0
    (tmp_path / "findings.json").write_text(json.dumps({"findings": [{"effect": "payload"}]}))
    assert [each["effect"] for each in newest_mismatch([tmp_path])["effects"]] == ["payload"]
