"""docs/architecture.md and docs/decisions: paths exist, each process and plugin is named."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PATHS = sorted(set(re.findall(r"`((?:daemon|drivers|plugins|tests|bench)/[\w./]+)`", PAGE.read_text())))


def test_paths_on_the_page_exist() -> None:
    assert [path for path in PATHS if not (ROOT / path).exists()] == []


def test_every_process_and_plugin_is_on_the_page() -> None:
    text = PAGE.read_text()
    plugins = {p.parent.name for p in (ROOT / "plugins" / "cellwatt_plugins").glob("*/__init__.py")}
    assert {p for p in plugins if f"plugins/cellwatt_plugins/{p}`" not in text} == set()
    processes = {p.stem for p in (ROOT / "daemon/cellwatt/runtime/processes").glob("*.py")}
    assert {
        p for p in ("collect", "align", "judge", "tell", "supervisor") if p not in processes or p not in text
    } == set()


def test_the_page_answers_ten_questions_or_more() -> None:
    rows = PAGE.read_text().partition("## Where is")[2].splitlines()
    assert sum(row.startswith("| W") for row in rows) >= 10


def test_decisions_are_numbered_and_listed() -> None:
    folder = ROOT / "docs" / "decisions"
    index = (folder / "index.md").read_text()
    files = sorted(folder.glob("0*.md"))
    assert [int(f.name[:4]) for f in files] == list(range(1, len(files) + 1))
    for file in files:
        text = file.read_text()
        assert f"({file.name})" in index
        assert [line for line in text.splitlines() if line.startswith("## ")] == [
            "## Context",
            "## Decision",
            "## Consequence",
        ]
        missing = [p for p in re.findall(r"`((?:daemon|drivers|plugins)/[\w./]+)`", text) if not (ROOT / p).exists()]
        assert missing == []
