"""docs/architecture.md and docs/decisions: paths and functions exist, each plugin is named."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text()
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("0*.md"))


def test_paths_on_the_pages_exist() -> None:
    text = "\n".join([PAGE, *(decision.read_text() for decision in DECISIONS)])
    paths = set(re.findall(r"`((?:daemon|drivers|plugins|tests|bench)/[\w./]+)`", text))
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_functions_of_the_diagrams_exist() -> None:
    source = "\n".join(path.read_text() for path in ROOT.glob("d*/cellwatt*/**/*.py"))
    named = re.findall(r"\b(_?[A-Z]\w+)\.(\w+)", PAGE.partition("## Where is")[0])
    patterns = {rf"^(class )?{owner}\b" for owner, _ in named} | {
        rf"^    (async )?(def )?{name}\b" for _, name in named
    }
    assert [pattern for pattern in patterns if not re.search(pattern, source, re.M)] == []


def test_every_plugin_is_on_the_page() -> None:
    plugins = {p.parent.name for p in (ROOT / "plugins" / "cellwatt_plugins").glob("*/__init__.py")}
    assert {p for p in plugins if f"plugins/cellwatt_plugins/{p}`" not in PAGE} == set()


def test_decisions_are_numbered_and_listed() -> None:
    index = (ROOT / "docs" / "decisions" / "index.md").read_text()
    assert [int(f.name[:4]) for f in DECISIONS] == list(range(1, len(DECISIONS) + 1))
    for file in DECISIONS:
        text = file.read_text()
        assert f"({file.name})" in index
        assert [line for line in text.splitlines() if line.startswith("## ")] == [
            "## Context",
            "## Decision",
            "## Consequence",
        ]
