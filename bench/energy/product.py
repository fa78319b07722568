"""The product at work on a simulated campaign."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Any

from cellwatt_plugins.energy.command import disaggregate

from .arms import Case
from .plant import write_campaign


def disaggregated(case: Case, folder: Path) -> dict[str, Any]:
    """Measure an arm to ``folder`` and split it to ``folder/out``; returns the key, which is the truth."""
    key = write_campaign(case, folder)
    words = ["--robot", str(folder / "robot.yaml"), "--runs", str(folder / "runs"), "--out", str(folder / "out")]
    for state in ("controller", "connected", "released"):
        words += [f"--{state}", str(folder / f"{state}.parquet")]
    with contextlib.redirect_stdout(sys.stderr):
        disaggregate.main(words, standalone_mode=False)
    return key
