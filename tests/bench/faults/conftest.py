import pytest

pytest.importorskip("mujoco", reason="the benchmark's plant needs MuJoCo")
