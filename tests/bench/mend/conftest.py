from tests.bench.concealed.conftest import bench

__all__ = ["bench"]
