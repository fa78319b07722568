"""docs/comparison.md: every row names a page and a test that are there; its counts are those of its rows."""

from __future__ import annotations

import re

from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
ROW = re.compile(
    r"^\| (\d+) \| ([^|]+) \| (yes|partly|\*\*no\*\*) \| ([^|]+) \| \[page]\(\S+\), `([^`]+)` \|", re.MULTILINE
)
ROWS = ROW.findall(PAGE)


def test_every_feature_has_a_row_that_names_a_test_and_the_counts_are_those_of_the_rows() -> None:
    assert [int(row[0]) for row in ROWS] == list(range(1, 44))
    for _, feature, _, how, test in ROWS:
        assert (ROOT / test).is_file(), f"{feature}: {test}"
        assert len(how) > 5
    yes, partly, no = (sum(row[2].strip("*") == verdict for row in ROWS) for verdict in ("yes", "partly", "no"))
    assert f"cellwatt: {yes} yes, {partly} partly, {no} no." in PAGE
