import pytest

pytest.importorskip("pinocchio", reason="the preparation of recordings needs the extra explain")
threadpoolctl = pytest.importorskip("threadpoolctl", reason="part of the extra explain")


@pytest.fixture(scope="package", autouse=True)
def one_thread():
    """Matrices are small: threads would wait for one another."""
    with threadpoolctl.threadpool_limits(1):
        yield
