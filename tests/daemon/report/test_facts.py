"""Facts in a page's head: read by programs, the broken named, the foreign passed over."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from cellwatt import __version__, report
from cellwatt.report.facts import BrokenPageError, facts_in
from tests.daemon.report.reading import check, read


@pytest.fixture
def page(tmp_path: Path) -> Path:
    origin = report.Provenance({"a.mcap": "00"}, "cellwatt plot a.mcap", {}, datetime(2026, 3, 4, 8, 30, tzinfo=UTC))
    facts, verdict = ["2 recordings"], "<script>alert(1)</script>"
    report.Report("weld-3", "recording", facts, verdict, [], "found", provenance=origin).write(tmp_path / "a.html")
    return tmp_path / "a.html"


def test_a_page_carries_its_facts(page: Path) -> None:
    facts = facts_in(page)
    assert facts is not None
    assert (facts.name, facts.kind, facts.finding) == ("weld-3", "recording", "<script>alert(1)</script>")
    assert (facts.about, facts.files, facts.command) == (("2 recordings",), {"a.mcap": "00"}, "cellwatt plot a.mcap")
    assert (facts.made, facts.version) == ("2026-03-04T08:30:00+00:00", __version__)
    check(read(page))


def test_a_page_of_others_has_none_and_one_that_is_not_whole_is_named(page: Path) -> None:
    whole = page.read_text()
    page.write_text("<!doctype html><title>Somebody else's</title>")
    assert facts_in(page) is None
    page.write_text(whole[: len(whole) // 2])
    with pytest.raises(BrokenPageError, match="the page ends too early: make it anew"):
        facts_in(page)
    page.write_text(whole.replace('"finding":', '"finds":'))
    with pytest.raises(BrokenPageError, match="its facts cannot be read: make the page anew"):
        facts_in(page)
