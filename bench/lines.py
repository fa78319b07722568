"""Lines of code of the project, a package at a time: without docstrings, comments, blank lines and imports.

python bench/lines.py [--depth 2] [--files]
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PARTS = ("daemon", "drivers", "plugins", "bench", "tests")
_QUIET = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
_BODIES = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(text: str) -> int:
    """Lines that hold code."""
    lines = {
        line
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in _QUIET
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        elif isinstance(node, _BODIES) and ast.get_docstring(node, clean=False) is not None:
            told = node.body[0]
            lines -= set(range(told.lineno, (told.end_lineno or told.lineno) + 1))
    return len(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--depth", type=int, default=2, help="folders below daemon, drivers … that are told apart")
    parser.add_argument("--files", action="store_true", help="each file, too")
    given = parser.parse_args()
    packages, sums, files = Counter[str](), Counter[str](), Counter[str]()
    for part in PARTS:
        for path in sorted((ROOT / part).rglob("*.py")):
            count, parents = code_lines(path.read_text("utf-8")), path.relative_to(ROOT).parent.parts
            sums[part] += count
            packages["/".join(parents[: given.depth + 1])] += count
            files[str(path.relative_to(ROOT))] = count
    for name, count in (files if given.files else packages).items():
        print(f"{count:7,} {name}")
    product = sum(sums[part] for part in PARTS[:3])
    print(f"{product:7,} product (daemon, drivers, plugins)", *(f"{sums[p]:7,} {p}" for p in PARTS[3:]), sep="\n")


if __name__ == "__main__":
    main()
