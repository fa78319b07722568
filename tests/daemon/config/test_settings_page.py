"""``docs/settings.md`` holds every key as in the code; python -m tests.daemon.config.test_settings_page writes it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from cellwatt.config.cell import CellName, FrameSettings
from cellwatt.config.installed import installed
from cellwatt.record.settings import RecordSettings
from cellwatt.units import Units
from tests.docs.pages import settings_table

pytestmark = pytest.mark.usefixtures("real_parts")

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "settings.md"
FIRST_GENERATED = "The same as `cellwatt drivers NAME` shows, which also knows what you have added.\n"


def tables() -> dict[str, str]:
    """Table by the name that its comment gives."""
    found = {"the cell": CellName, "frames": FrameSettings, "record": RecordSettings, "units": Units}
    return {name: settings_table(model) for name, model in found.items()}


def parts() -> dict[str, str]:
    """Title and table of each part that this distribution brings."""
    ours = [p for p in installed() if p.package == "cellwatt"]
    missing = [f"{p.kind} {p.name}: {p.error}" for p in ours if p.settings is None]
    assert not missing, missing
    return {f"{p.kind}: {p.name}": settings_table(p.settings) for p in ours if p.settings is not None}


def updated(page: str) -> str:
    for name, table in tables().items():
        page = re.sub(
            rf"(<!-- settings of {name} -->\n)(\n\|.*?\n(?=\n))?",
            lambda m, table=table: f"{m[1]}\n{table}\n",
            page,
            flags=re.DOTALL,
        )
    head = page[: page.index(FIRST_GENERATED)] + FIRST_GENERATED
    return head + "".join(f"\n### {title}\n\n{table}\n" for title, table in parts().items())


def test_every_key_is_on_the_page():
    page = PAGE.read_text(encoding="utf-8")
    assert page == updated(page)


def test_navigation_and_links_name_files_that_are_pages():
    navigation = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]

    def pages(node):
        if isinstance(node, str):
            yield node
        for child in node if isinstance(node, list) else node.values() if isinstance(node, dict) else ():
            yield from pages(child)

    linked = {"index.md"}
    for index in ("index.md", "decisions/index.md"):
        text = (ROOT / "docs" / index).read_text(encoding="utf-8")
        linked |= {str(Path(index).parent / found) for found in re.findall(r"\]\(([0-9a-z_/-]+\.md)\)", text)}
    assert linked == set(pages(navigation))


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
