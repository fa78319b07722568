"""The benchmark of `cellwatt faults`: the same figures here and by two workers."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"
TIMES = ("cells_on_one_core",)


def figures(*words: str) -> dict:
    done = subprocess.run(
        [sys.executable, str(BENCH / "faults.py"), "--json", "--cases", "2", "--cycles", "3", *words],
        capture_output=True,
        text=True,
        check=True,
    )
    return {name: value for name, value in json.loads(done.stdout).items() if name not in TIMES}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [(), ("--healthy",)])
def test_workers_come_to_the_same_figures(kind):
    here = figures(*kind)
    assert here["intervals" if kind else "cycles"] > 0
    assert figures(*kind, "--scheduler", "local:2") == here
