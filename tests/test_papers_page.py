"""docs/papers.md has a row for each equation, table and figure of the papers, and what its rows name exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "papers.md"
PLUGINS = ROOT / "plugins" / "cellwatt_plugins"

PAPERS = {
    "The hybrid static model": {"equations": 5, "Table": 3, "Fig.": 6},  # its second (4) to (7) are called (V.4) …
    "NLS and SCG": {"equations": 15, "Table": 2, "Fig.": 16},
    "Faults from power and encoders": {"equations": 20, "Table": 3, "Fig.": 20},
    "ECDP": {"equations": 21, "Table": 3, "Fig.": 8},
}
"""By heading of the page, how many of each its paper numbers."""
ROMAN = {"I": 1, "II": 2, "III": 3}


def rows(heading: str) -> list[list[str]]:
    section = PAGE.read_text().partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    found = [line.strip("|").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row] for row in found[1:]]


def numbers(text: str) -> set[int]:
    """Of ``1, 3–5``: 1, 3, 4 and 5."""
    found: set[int] = set()
    for first, last in re.findall(r"(\d+)(?:–(\d+))?", text):
        found |= set(range(int(first), int(last or first) + 1))
    return found


def told(heading: str, kind: str) -> set[int]:
    found: set[int] = set()
    for what, *_ in rows(heading):
        if kind == "equations":
            for first, last in re.findall(r"\((\d+)\)(?:–\((\d+)\))?", what):
                found |= set(range(int(first), int(last or first) + 1))
        elif kind == "Table":
            for words in re.findall(r"Tables? ((?:[IVX]+(?:, | and )?)+)", what):
                found |= {ROMAN[word] for word in re.findall(r"[IVX]+", words)}
        else:
            for words in re.findall(r"Fig\. ([\d–, ]+)", what):
                found |= numbers(words)
    return found


@pytest.mark.parametrize("kind", ["equations", "Table", "Fig."])
@pytest.mark.parametrize("heading", PAPERS)
def test_nothing_is_left_without_a_row(heading: str, kind: str) -> None:
    count = PAPERS[heading][kind]
    assert set(range(1, count + 1)) - told(heading, kind) == set()


@pytest.mark.parametrize("heading", PAPERS)
def test_every_row_says_where_it_is_or_why_it_is_left_out(heading: str) -> None:
    for what, where, held, used in rows(heading):
        assert all((where, held, used)), what
        assert held != "–" or where == "–" or used != "–", f"{what}: nothing holds it, nothing uses it"


@pytest.mark.parametrize("heading", PAPERS)
def test_tests_and_modules_named_are_there(heading: str) -> None:
    for what, where, held, _ in rows(heading):
        for name in re.findall(r"`([\w./]+\.py|[\w/]+/)`", where):
            places = [PLUGINS / name, ROOT / name]
            assert any(place.exists() for place in places), f"{what}: {name}"
        for name in re.findall(r"`([\w./]+)(?:::\w+)?`", held):
            assert (ROOT / "tests" / name).exists(), f"{what}: {name}"
        for name, test in re.findall(r"`([\w./]+)::(\w+)`", held):
            assert f"def {test}(" in (ROOT / "tests" / name).read_text(), f"{what}: {name}::{test}"
