"""Processes of the benchmark: modules of this package, spoken to as those of ``capacity``."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from pathlib import Path

from capacity.children import Child, running

HERE = Path(__file__).resolve().parent.parent


def child(module: str, *words: str) -> AbstractContextManager[Child]:
    """A module as a process for as long as the context lasts."""
    paths = {"PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])}
    return running(Child(["-m", f"outlet.{module}", *words], {**os.environ, **paths}))
