"""The costs of the page, and the command that tells them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from capacity.cost import LISTS, Question, answers, lake_of, table

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "capacity.md"


@pytest.mark.parametrize("name", list(LISTS))
def test_the_page_has_the_costs_of_the_model(name: str) -> None:
    assert table(Question(), LISTS[name]) in PAGE.read_text(encoding="utf-8")


def test_what_a_cell_writes_goes_with_its_channels() -> None:
    assert lake_of(1.0, True, 120).bytes == pytest.approx(2 * lake_of(1.0, True, 60).bytes)


def test_a_year_of_1000_cells_at_1_row_a_second_by_hand() -> None:
    # 42.3 MB a day and cell in 144 files: 15,440 GB at the end of the year, half of that over twelve months.
    # PUT: 52.56 million. GET: a week of each cell a day, 144 files a day, three requests each.
    first, later = next((a.first, a.later) for a in answers(Question(), LISTS["S3 Standard"]))
    assert first.storage == pytest.approx(42.3e-3 * 1000 * 365 / 2 * 12 * 0.023)
    assert first.put == pytest.approx(52.56e6 / 1000 * 0.005)
    assert first.get == pytest.approx(1000 * 7 * 365 * 144 * 3 / 1000 * 0.0004)
    assert first.egress == pytest.approx(1000 * 7 * 365 * 42.3e-3 / 32 * 0.09)
    assert later.storage == pytest.approx(2 * first.storage)


def test_the_command_takes_prices_and_measures_nothing_for_them() -> None:
    words = ("--only", "cost", "--markdown", "--cells", "10", "--weeks-read", "0", "--price-gb-month", "1")
    command = [sys.executable, str(ROOT / "bench" / "capacity.py"), *words]
    told = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    row = re.search(r"^\| 1 \| 144 \| .*$", told, re.MULTILINE)
    assert row is not None
    # 0.423 GB a day of ten cells: 926 GB-months at one a GB and month, 525,600 files.
    assert row[0] == "| 1 | 144 | 0 | 926 | 3 | 0 | 0 | 0 | **929** | 1,855 |"
