import pytest

from tests.bench.concealed.conftest import bench

pytest.importorskip("mujoco", reason="the arms are MuJoCo files")

__all__ = ["bench"]
