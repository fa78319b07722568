"""Friction at rest: what a loop lets go of while nothing moves was held."""

from types import SimpleNamespace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.holding import held_at_rest

STEP, NOISE = 0.005, 0.02


def course(held: float):
    """A joint that rests twelve times, a second of every two, while a torque of ``held`` (rms) decays within 0.2 s."""
    draw = np.random.default_rng(1)
    resting = np.tile(np.repeat([False, True], 200), 12)
    sizes = held * draw.choice([-1.0, 1.0], 12)
    decay = np.exp(-np.arange(200) * STEP / 0.2)
    left = np.concatenate([np.concatenate([np.zeros(200), size * decay]) for size in sizes])
    rests = SimpleNamespace(resting=resting[:, None], step=STEP, unplanned=False)
    return rests, (left + NOISE * draw.standard_normal(len(left)))[:, None]


@pytest.mark.parametrize(("held", "least", "most"), [(0.0, 0.0, 0.02), (3.0, 2.0, 5.0)])
def test_what_changes_at_rest_was_held(held, least, most):
    rests, left = course(held)
    assert least <= held_at_rest([rests], [left], np.array([NOISE]))[0] <= most


def test_without_a_plan_anything_may_be_held():
    rests, left = course(0.0)
    rests.unplanned = True
    assert np.isinf(held_at_rest([rests], [left], np.array([NOISE]))).all()
