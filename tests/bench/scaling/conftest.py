import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[3] / "bench"))
pytest.importorskip("mujoco", reason="the benchmark's plant needs MuJoCo")
