import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[3] / "bench"))
pytest.importorskip("pinocchio", reason="the benchmark of models needs the extra train")
pytest.importorskip("mujoco", reason="the arms at rest of the benchmark are emulated by MuJoCo")
