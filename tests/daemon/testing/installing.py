"""Installs a package next to cellwatt, in a folder that only the processes of one test see."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def install(package: Path, site: Path) -> Path:
    """Install without its dependencies, and without a network; gives ``site``."""
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    _run([sys.executable, "-m", "pip", "install", *options, "--target", str(site), str(package)], os.environ, None)
    return site


def call(site: Path, *arguments: str, cwd: Path | None = None) -> str:
    """What Python says, called with these arguments where the installed packages are seen."""
    environment = dict(os.environ, PYTHONPATH=str(site), COLUMNS="200")
    return _run([sys.executable, *arguments], environment, cwd)


def _run(command: list[str], environment: dict[str, str], cwd: Path | None) -> str:
    done = subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
