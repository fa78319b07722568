import pytest

pytest.importorskip("mujoco", reason="the arms are MuJoCo files")
