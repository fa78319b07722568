"""The built page is what its sources give, names no host, and has all of its texts."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import cellwatt.outlets.page as page

ROOM = Path(page.__file__).parent
FRONT, STATIC = ROOM / "front", ROOM / "static"
BUILD = "run npm run build in daemon/cellwatt/outlets/page/front"
ADDRESS = re.compile(rb"(?:https?|wss?)://([a-zA-Z0-9.-]+)")
HARMLESS = {b"www.w3.org", b"127.0.0.1"}
"""Of XML namespaces, and this machine."""
KEY = re.compile(r"""["']([a-z]+\.[a-z0-9_]+)["']""")
AT_MOST = 300_000
"""Bytes that are sent before the first curve."""


def sources() -> Iterator[tuple[str, Path]]:
    for path in FRONT.rglob("*"):
        name = path.relative_to(FRONT)
        if path.is_file() and "node_modules" not in name.parts:
            yield name.as_posix(), path


def built() -> dict[str, Path]:
    return {path.relative_to(STATIC).as_posix(): path for path in STATIC.rglob("*") if path.is_file()}


def code() -> str:
    """All that is written in TypeScript."""
    return "".join(path.read_text() for name, path in sources() if name.startswith("src/") and name.endswith(".ts"))


def manifest() -> dict[str, object]:
    found: dict[str, object] = json.loads((STATIC / "manifest.json").read_bytes())
    return found


def test_the_page_is_built_from_its_sources() -> None:
    digest = hashlib.sha256()
    for name, path in sorted(sources()):
        content = path.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    assert manifest()["sources_sha256"] == digest.hexdigest(), f"sources have changed: {BUILD}"


def test_the_built_files_are_those_of_the_build() -> None:
    files = {name: path.read_bytes() for name, path in built().items() if name != "manifest.json"}
    told = {
        name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()} for name, content in files.items()
    }
    assert manifest()["files"] == told, f"built files were changed by hand: {BUILD}"


def test_no_file_names_a_host() -> None:
    files = [path for _, path in sources()] + list(built().values())
    named = {path.name: set(ADDRESS.findall(path.read_bytes())) - HARMLESS for path in files}
    assert {name: hosts for name, hosts in named.items() if hosts} == {}
    assert b'"resolved"' not in (FRONT / "package-lock.json").read_bytes()


def test_the_page_has_no_script_or_style_of_its_own() -> None:
    index = (STATIC / "index.html").read_text()
    assert "style=" not in index and "<style" not in index
    scripts = re.findall(r"<script[^>]*>(.*?)</script>", index, re.DOTALL)
    assert scripts == [""]
    for forbidden in ("innerHTML", "insertAdjacentHTML", "document.write", "setAttribute('style'", "eval("):
        assert forbidden not in code()


def test_all_texts_are_used_and_all_that_are_used_are_there() -> None:
    texts = json.loads((FRONT / "src/texts/en.json").read_bytes())
    used = set(KEY.findall(code()))
    assert set(texts) - used == set()
    rooms = {key.partition(".")[0] for key in texts}
    asked = set(re.findall(r"""\b(?:t|counted)\((?:\w+, )?["']([^"']+)["']""", code()))
    assert asked, "no text is used at all"
    assert asked - set(texts) == set()
    assert {key for key in used if key.partition(".")[0] in rooms} - set(texts) <= {"bus.power", "supply.power"}


def test_the_page_is_small() -> None:
    index = (STATIC / "index.html").read_text()
    first = re.findall(r'(?:src|href)="/([^"]+)"', index)
    assert any(name.endswith(".js") for name in first) and any(name.endswith(".css") for name in first)
    assert len(index) + sum((STATIC / name).stat().st_size for name in first) < AT_MOST


@pytest.mark.skipif(not (FRONT / "node_modules").is_dir(), reason="front/node_modules is missing: run npm ci there")
def test_the_front_end_passes_its_own_tests() -> None:
    npx = shutil.which("npx")
    if npx is None:
        pytest.skip("npx is not installed")
    done = subprocess.run([npx, "vitest", "run"], cwd=FRONT, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
