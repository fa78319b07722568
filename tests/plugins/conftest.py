"""The plants of the benchmarks, which tests of several plugins judge by, can be imported."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))
