"""docs/emulators.md: its table is made from the code, and its examples run.

``python -m tests.daemon.emulation.test_emulators_page`` writes the table anew.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

from cellwatt.commands.emulate import command
from cellwatt.config import load
from cellwatt.emulation.cell import devices_of, emulator_of, faults_by_device
from cellwatt.emulation.words import WORLD, keys_of, kinds_of, mishap
from cellwatt.registry import available
from tests.daemon.emulation.test_emulate import asked, cell, ends_with_its_input, said, started

PAGE = Path(__file__).resolve().parents[3] / "docs" / "emulators.md"
TABLE = re.compile(r"(?<=<!-- kinds -->\n).*(?=<!-- end of kinds -->)", re.DOTALL)


def table() -> str:
    """Kinds of faults, what the page says of them, their keys, and the drivers whose emulators know them."""
    meaning = dict(re.findall(r"^\| `(\w+)` \| (.*?) \| `", PAGE.read_text(), re.MULTILINE))
    keys: dict[str, tuple[str, ...]] = {}
    drivers: dict[str, list[str]] = {}
    for driver in available("cellwatt.drivers"):
        for kind in kinds_of(emulator_of(driver)):
            keys.setdefault(kind, keys_of(kind, emulator_of(driver)))
            drivers.setdefault(kind, []).append(driver)
    everywhere = len(available("cellwatt.drivers"))
    lines = ["| kind | what happens | keys | drivers |", "|---|---|---|---|"]
    for kind in sorted(keys, key=lambda kind: (kind not in WORLD, kind)):
        known = "all" if len(drivers[kind]) == everywhere else ", ".join(drivers[kind])
        lines.append(f"| `{kind}` | {meaning.get(kind)} | {', '.join(f'`{key}`' for key in keys[kind])} | {known} |")
    return "\n" + "\n".join(lines) + "\n\n"


def blocks(language: str) -> list[str]:
    found: list[str] = re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    return "".join(found).splitlines()


def test_the_table_is_that_of_the_code() -> None:
    found = TABLE.search(PAGE.read_text())
    assert found is not None and found[0] == table(), "python -m tests.daemon.emulation.test_emulators_page"


def test_the_commands_are_understood(tmp_path: Path) -> None:
    devices = devices_of(load(cell(tmp_path)))
    for line in blocks("sh"):
        program, name, *arguments = shlex.split(line)
        assert (program, name) == ("cellwatt", "emulate")
        (tmp_path / "cell.yaml").touch()
        arguments = [str(cell(tmp_path)) if word == "cell.yaml" else word for word in arguments]
        given = command.make_context(name, arguments).params
        if given["cell"] is None:
            emulator = emulator_of(given["driver"])
            assert all(mishap(fault, emulator) for fault in given["faults"])
        else:
            assert all(faults_by_device(given["faults"], devices)) or not given["faults"]


async def test_the_lines_of_control_are_obeyed(tmp_path: Path) -> None:
    process = await started("--cell", str(cell(tmp_path)), "--control")
    assert set((await said(process))["ready"]) == {"arm", "supply", "board"}
    *orders, count = blocks("json")
    for order in orders:
        assert await asked(process, **json.loads(order)) == {"ok": True}
    assert "counts" in await asked(process, **json.loads(count))
    await ends_with_its_input(process)


if __name__ == "__main__":
    PAGE.write_text(TABLE.sub(lambda _: table(), PAGE.read_text()))
