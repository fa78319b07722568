"""A benchmark's plant must share no code with the product that it judges."""

from __future__ import annotations

import ast
from pathlib import Path

FORBIDDEN = {"cellwatt", "cellwatt_drivers", "cellwatt_plugins", "pinocchio"}
GIVES_OUT_WORK = {"cellwatt.progress", "cellwatt.scheduler"}
"""Parts of the product that know nothing of arms: which process does a case, and how far all are."""


def imported(text: str) -> set[str]:
    """Names of all modules that a source imports; relative ones as ``.``."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("." if node.level else str(node.module))
    return found


def assert_shares_no_code(folder: Path) -> None:
    """Raise ``AssertionError`` if a module below ``folder`` imports the product or its rigid bodies."""
    for file in folder.rglob("*.py"):
        assert not {n.split(".")[0] for n in imported(file.read_text()) - GIVES_OUT_WORK} & FORBIDDEN, file
