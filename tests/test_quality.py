"""The rules of the code base, held by tools: lint, format, types, import directions, clean text."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ["daemon", "drivers", "plugins", "tests", "bench", "examples", "fuzz"]


@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    "tool",
    [
        ["-m", "ruff", "check", "--no-cache", *SOURCES],
        ["-m", "ruff", "format", "--no-cache", "--check", *SOURCES],
        ["-m", "mypy"],
        ["-c", "from importlinter.cli import lint_imports_command as c; c()", "--no-cache"],
    ],
    ids=["lint", "format", "types", "imports"],
)
def test_tool_is_content(tool: list[str]) -> None:
    done = subprocess.run([sys.executable, *tool], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_module_imports_itself_by_way_of_others() -> None:
    graph = grimp.build_graph("cellwatt", "cellwatt_drivers", "cellwatt_plugins", cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    TopologicalSorter(imports).prepare()  # raises CycleError with the modules of a circle


def test_benchmarks_import_what_is_there() -> None:
    roots = {"cellwatt": "daemon", "cellwatt_drivers": "drivers", "cellwatt_plugins": "plugins"}
    roots |= {folder.name: "bench" for folder in (ROOT / "bench").iterdir() if (folder / "__init__.py").exists()}
    imports = {
        (node.module, name.name)
        for part in ("bench", "fuzz")
        for path in (ROOT / part).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] in roots
        for name in node.names
    }
    absent = []
    for module, name in imports:
        stem = ROOT / roots[module.partition(".")[0]] / module.replace(".", "/")
        files = [f for f in (stem.with_suffix(".py"), stem / "__init__.py") if f.is_file()]
        if any((stem / f"{name}{end}").exists() for end in ("", ".py")):
            continue
        if not any(re.search(rf"\b{name}\b", file.read_text()) for file in files):
            absent.append(f"{module}.{name}")
    assert not absent


def test_pinned_files_name_no_host() -> None:
    for name in ("constraints.txt", "constraints-test.txt"):
        text = (ROOT / name).read_text()
        assert "://" not in text
        for line in re.findall(r"^[A-Za-z].*$", text, re.MULTILINE):
            assert re.match(r"[\w.-]+(\[[\w,]+\])?==[\w.!+]+( ; .*)? \\$", line), line
