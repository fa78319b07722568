import numpy as np
import pytest


@pytest.fixture
def values():
    """Values of 40 frames."""
    return np.random.default_rng(1).uniform(-2, 2, (40, 5))
