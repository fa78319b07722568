"""A benchmark's plant must share no code with the product that it judges."""

from __future__ import annotations

import ast
from pathlib import Path

FORBIDDEN = {"cellwatt", "cellwatt_drivers", "cellwatt_plugins", "pinocchio"}
GIVES_OUT_WORK = {"cellwatt.progress", "cellwatt.scheduler"}
"""Parts of the product that know nothing of arms: which process does a case, and how far all are."""


def assert_shares_no_code(folder: Path) -> None:
    """Raise ``AssertionError`` if a module below ``folder`` imports the product or its rigid bodies."""
    for file in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {n.split(".")[0] for n in names if n not in GIVES_OUT_WORK} & FORBIDDEN, file
