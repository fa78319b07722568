"""docs/comparison.md: every row names a page and a test that are there; its counts are those of its rows."""

from __future__ import annotations

import re

from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
ROW = re.compile(
    r"^\| (?:(\d+) \| )?([^|]+) \| (yes|partly|\*\*no\*\*) \| ([^|]+) \| \[page]\(\S+\), `([^`]+)` \|", re.MULTILINE
)
NUMBERED = [row for row in ROW.findall(PAGE) if row[0]]
NEW = [row for row in ROW.findall(PAGE) if not row[0]]


def counts(rows: list[tuple[str, ...]]) -> dict[str, int]:
    """Number of rows by verdict."""
    verdicts = [row[2].strip("*") for row in rows]
    return {verdict: verdicts.count(verdict) for verdict in ("yes", "partly", "no")}


def test_every_feature_has_a_row() -> None:
    assert [int(row[0]) for row in NUMBERED] == list(range(1, 44))
    assert len(NEW) == 17


def test_every_row_names_a_test_that_is_there() -> None:
    for _, feature, _, how, test in (*NUMBERED, *NEW):
        assert (ROOT / test).is_file(), f"{feature}: {test}"
        assert len(how) > 5


def test_the_counts_are_those_of_the_rows() -> None:
    found = counts(NUMBERED)
    assert f"cellwatt: {found['yes']} yes, {found['partly']} partly, {found['no']} no." in PAGE
    assert f"{counts(NEW)['yes']} are here, {counts(NEW)['partly']} in part" in PAGE
