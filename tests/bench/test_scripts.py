import subprocess
import sys
from pathlib import Path

BENCH = Path(__file__).resolve().parents[2] / "bench"


def test_every_script_finds_what_it_imports():
    """Some of it stands with the tests, where nothing else may need it."""
    names = sorted(path.stem for path in BENCH.glob("*.py"))
    assert "soak" in names
    subprocess.run([sys.executable, "-c", f"import {', '.join(names)}"], cwd=BENCH, check=True)
