"""Build the sdist, the wheel from it, and the Debian package: ``python -m release.build [--snapshot] [--no-deb]``.

The version stands in pyproject.toml alone. A release is refused unless the tree is clean, the commit carries the tag
v<version> and CHANGELOG.md has that heading. Neither git nor the network is needed for a snapshot's sdist and wheel.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

from release import deb

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"


def version(root: Path = ROOT) -> str:
    """The version in pyproject.toml."""
    found: str = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    return found


def obstacles(root: Path = ROOT) -> list[str]:
    """Return why this commit is no release, a line each."""
    number = version(root)
    found = []
    if _git(root, "status", "--porcelain") != "":
        found.append("the tree has changes that are not committed, or git cannot tell")
    if f"v{number}" not in (_git(root, "tag", "--points-at", "HEAD") or "").split():
        found.append(f"the commit has no tag v{number}: git tag v{number}")
    if not re.search(rf"^## {re.escape(number)}\b", (root / "CHANGELOG.md").read_text(), re.MULTILINE):
        found.append(f"CHANGELOG.md has no heading '## {number}'")
    return found


def _git(root: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def sdist(out: Path) -> Path:
    """Build the sdist from the tree."""
    return _hatch(ROOT, "sdist", out)


def wheel(source: Path, out: Path) -> Path:
    """Build the wheel from an sdist and nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(source) as archive:
            archive.extractall(folder, filter="data")
        return _hatch(next(Path(folder).iterdir()), "wheel", out)


def _hatch(root: Path, target: str, out: Path) -> Path:
    before = set(out.glob("*"))
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(out)]
    subprocess.run(command, cwd=root, check=True, stdout=subprocess.DEVNULL)
    made = [*(set(out.glob("*")) - before), *out.glob("*.tar.gz" if target == "sdist" else "*.whl")]
    return made[0]


def main() -> None:
    """Build into dist/, which is emptied first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--snapshot", action="store_true", help="build a commit that is no release")
    parser.add_argument("--no-deb", action="store_true", help="leave out the Debian package")
    options = parser.parse_args()
    if found := obstacles():
        print("snapshot, not a release:" if options.snapshot else "refused, no release:", *found, sep="\n- ")
        if not options.snapshot:
            sys.exit("give --snapshot to build it all the same")
    DIST.mkdir(exist_ok=True)
    for old in [*DIST.glob("cellwatt[-_]*.tar.gz"), *DIST.glob("cellwatt*.whl"), *DIST.glob("cellwatt_*.deb")]:
        old.unlink()
    source = sdist(DIST)
    built = [source, wheel(source, DIST)]
    if not options.no_deb:
        built.append(deb.build(built[1], version(), DIST))
    for file in built:
        print(f"{file.relative_to(ROOT)}: {file.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
