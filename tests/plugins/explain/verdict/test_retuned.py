"""Numbers of the simulation that moved."""

import json

import numpy as np

from cellwatt_plugins.explain.verdict.retuned import _link


def test_moments_of_inertia_that_alone_moved_are_plain_numbers_of_a_file() -> None:
    own = np.array([1.0, 0.0, 0.0, 0.1, 0.02, 0.0, 0.02, 0.0, 0.0, 0.01])
    off, spread = np.zeros(10), np.diag(np.full(10, 1e-6))
    off[9] = 0.03
    moved = {m.parameter: m for m in _link(0, own, off, spread, 0.05)}
    assert moved["izz"].beyond
    assert not moved["ixx"].beyond
    json.dumps([(m.was, m.off, m.std, m.tolerance, m.beyond) for m in moved.values()])
