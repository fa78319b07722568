import pytest

pytest.importorskip("pinocchio", reason="the benchmark of models needs the extra train")
pytest.importorskip("mujoco", reason="the arms at rest of the benchmark are emulated by MuJoCo")
