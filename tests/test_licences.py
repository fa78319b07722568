"""The bill of materials against what is installed; docs/licences.md, which python -m tests.test_licences writes."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, distribution, distributions
from pathlib import Path

from cellwatt.sbom import licence, normal, purl, sbom

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
    """The licence of what is installed under a name."""
    try:
        found = licence(distribution(name))
    except PackageNotFoundError:
        return None
    text = found.get("expression") or found["license"]["name"]
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


def test_the_bill_of_materials_is_what_is_installed() -> None:
    found = sbom()
    there = {(normal(d.name), d.version) for d in distributions()}
    components = [*found["components"], found["metadata"]["component"]]
    assert {(normal(c["name"]), c["version"]) for c in components} == there
    assert found["bomFormat"] == "CycloneDX"
    assert re.fullmatch(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", found["serialNumber"])
    for component in components:
        assert component["type"] in ("library", "application")
        assert component["bom-ref"] == component["purl"]
        assert component["licenses"]
    references = [d["ref"] for d in found["dependencies"]]
    assert sorted(references) == sorted({c["bom-ref"] for c in components})
    assert all(set(d["dependsOn"]) <= set(references) for d in found["dependencies"])
    ours = next(d for d in found["dependencies"] if d["ref"] == purl(distribution("cellwatt")))
    assert {"pydantic", "numpy", "eclipse-zenoh"} <= {
        ref.partition("@")[0].rpartition("/")[2] for ref in ours["dependsOn"]
    }


def test_the_same_environment_gives_the_same_bytes() -> None:
    made = []
    for seed in ("1", "2"):
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path), "LC_ALL": "C.UTF-8"}
        command = [sys.executable, "-m", "cellwatt.sbom"]
        made.append(subprocess.run(command, capture_output=True, check=True, env=environment).stdout)
    assert made[0] == made[1]
    assert made[0].count(b'"purl"') == len({normal(d.name) for d in distributions()})


def test_licence_is_declared_and_there() -> None:
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
    assert 'license = "Apache-2.0"\nlicense-files = ["LICENSE"]\n' in (ROOT / "pyproject.toml").read_text()


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text()))
