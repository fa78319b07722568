"""Blows after a load turned over, and residuals that are none."""

from types import SimpleNamespace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.rows import Thinned
from cellwatt_plugins.explain.verdict.unfollowed import rebounds

STEP = 0.01
TIME = np.arange(4000) * STEP
LOAD = np.sin(2 * np.pi * 0.4 * TIME)
SINCE_LOAD, SINCE_MOTION = ((TIME + ahead) % 1.25 for ahead in (0.0, 0.6))


def solution(residual):
    states = SimpleNamespace(load=LOAD[:, None])
    design = SimpleNamespace(root=np.ones((len(TIME), 1)))
    problem = SimpleNamespace(states=[states], rows=[Thinned(len(TIME), 1, STEP)], design=design)
    return SimpleNamespace(problem=problem, residual=residual[:, None])


def ringing(since):
    noise = np.random.default_rng(5).normal(size=len(TIME))
    return noise + 20 * np.exp(-since / 0.05) * np.sin(2 * np.pi * 17 * TIME)


def test_blows_after_the_load_turned_over_are_rebounds():
    assert rebounds(solution(ringing(SINCE_LOAD)), 0) == pytest.approx(0.15 / 1.25, abs=0.02)


@pytest.mark.parametrize("residual", [ringing(SINCE_MOTION), ringing(SINCE_LOAD) + 4 * LOAD, 0.1 * ringing(SINCE_LOAD)])
def test_what_rings_at_other_times_or_is_left_at_other_times_is_no_rebound(residual):
    assert rebounds(solution(residual), 0) is None
