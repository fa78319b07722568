"""``fleet.json`` and ``fleet.csv``, and what a person reads at the terminal."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from cellwatt.files import write_csv, write_file
from cellwatt_plugins.fleet.findings import Fleet

COLUMNS: Final = (
    "cell", "kind", "joint", "quantity", "what", "change", "low", "high", "unit", "change_a_week", "first", "last",
    "sure_since", "statement",
)  # fmt: skip
MOST_SKIPPED: Final = 5
"""Skipped recordings that the terminal lists."""


def write(found: Fleet, out: Path) -> None:
    """Write fleet.json, and fleet.csv, the one table: findings by cell. Raises ``CellwattError``."""
    write_file(out / "fleet.json", json.dumps(found.as_json(), indent=1))
    write_csv(out / "fleet.csv", [COLUMNS, *_rows(found)])


def _rows(found: Fleet) -> list[tuple[object, ...]]:
    return [
        (
            f.cell, f.kind, f.joint or "", f.quantity, f.what, f"{f.percent:.4g}", f"{f.low:.4g}", f"{f.high:.4g}",
            unit_of(f.quantity), "" if f.percent_a_week is None else f"{f.percent_a_week:.4g}", f.first, f.last,
            f.sure_since or "", f.statement,
        )
        for f in found.findings
    ]  # fmt: skip


def unit_of(quantity: str) -> str:
    """Return the unit of a change: kg for load, % for all others."""
    return "kg" if quantity == "load" else "%"


def headline(found: Fleet) -> str:
    """Return the verdict in one sentence."""
    worn = [f for f in found.findings if f.what == "wears"]
    other = len({f.cell for f in found.findings if f.what != "wears"})
    told = f"{len(found.cells)} cell{'s' * (len(found.cells) != 1)} over {found.weeks} weeks"
    if not found.findings:
        return f"No joint wears and no cell drifts, of {told}."
    wear = f"{len(worn)} joint{'s wear' if len(worn) != 1 else ' wears'}"
    changed = f"{other} cell{'s' * (other != 1)} changed otherwise"
    return f"{wear}, {changed}, of {told}."


def in_words(found: Fleet, out: Path) -> str:
    """Return what is printed."""
    lines = [headline(found)]
    lines += [f"  • {f.statement}" for f in found.findings]
    lines += [f"  ? {c.cell}: {c.statement}" for c in found.cells if c.statement]
    lines += [f"  note: {note}" for note in found.notes]
    lines += [f"  skipped {s.place}: {s.why}" for s in found.skipped[:MOST_SKIPPED]]
    more = len(found.skipped) - MOST_SKIPPED
    lines += [f"  skipped {more} more, all in fleet.json"] if more > 0 else []
    written = ", ".join(n for n in ("fleet.json", "fleet.csv", "report.html") if (out / n).exists())
    return "\n".join([*lines, f"written to {out}: {written}"])
