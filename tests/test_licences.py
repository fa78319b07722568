"""docs/licences.md, which python -m tests.test_licences writes."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "licences.md"
START, END = "<!-- what runs -->\n", "<!-- end of what runs -->\n"
COPYLEFT = {
    "python-can": "LGPL-3.0-only",
    "asyncua": "GNU Lesser General Public License v3 or later (LGPLv3+)",
    "certifi": "MPL-2.0",
    "paho-mqtt": "EPL-2.0 OR BSD-3-Clause",
    "pathspec": "MPL-2.0",
    "tqdm": "MPL-2.0 AND MIT",
    "eclipse-zenoh": "Apache Software License / Eclipse Public License 2.0 (EPL-2.0)",
}
"""What the page says more of."""
SHORT = {"Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0"}


def pinned() -> list[str]:
    """Names of all that runs, extras included."""
    return re.findall(r"^([A-Za-z][\w.-]*)==", (ROOT / "constraints.txt").read_text(), re.MULTILINE)


def words(name: str) -> str | None:
    """The licence that an installed package states: its SPDX expression, else its classifiers, else its own words."""
    try:
        about = distribution(name).metadata
    except PackageNotFoundError:
        return None
    classes = [c.rpartition(" :: ")[2] for c in about.get_all("Classifier", []) if c.startswith("License ::")]
    stated = about.get("License", "").strip().splitlines()[:1]
    text = about.get("License-Expression") or " / ".join(classes or stated) or "not stated"
    return SHORT.get(text, text)


def table(page: str) -> str:
    known = dict(re.findall(r"^\| (\S+) \| (.*) \|$", page, re.MULTILINE))
    rows = [f"| {name} | {words(name) or known.get(name, 'not installed here')} |\n" for name in pinned()]
    return "| package | licence, as it states it |\n|---|---|\n" + "".join(rows)


def updated(page: str) -> str:
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    return f"{before}{START}\n{table(page)}\n{END}{after}"


def test_the_page_lists_all_that_runs() -> None:
    assert PAGE.read_text() == updated(PAGE.read_text()), "run: python -m tests.test_licences"


def test_nothing_that_runs_asks_for_more_than_the_page_says() -> None:
    copyleft = {
        name: words(name) for name in pinned() if re.search(r"GPL|MPL|EPL|CDDL|General Public", words(name) or "")
    }
    assert copyleft == {name: text for name, text in COPYLEFT.items() if name in copyleft}
    for name in COPYLEFT:
        assert f"**{name}**" in PAGE.read_text()


def test_licence_is_declared_and_there() -> None:
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
    assert 'license = "Apache-2.0"\nlicense-files = ["LICENSE"]\n' in (ROOT / "pyproject.toml").read_text()


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text()))
