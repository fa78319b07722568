import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_plugins.faults.isolate import agreement, likeness, suspects

MOVING = np.array([[1, 0, 0], [0, 1, 1], [0, 0, 1], [0, 1, 0], [1, 0, 1]], dtype=np.int8)
NO_SHAPE = np.zeros(3)


def codes(*values):
    return np.array(values, dtype=np.int8)


def test_agreement_is_the_share_of_intervals_that_match():
    assert agreement(codes(0, 1, -1, 0, 1), MOVING) == pytest.approx([1 / 4, 1 / 4, 1.0])


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (codes(0, 1, -1, 0, 1), [(3, ())]),
        (codes(1, 0, 0, 0, -1), [(1, ())]),
        (codes(0, 1, 0, 1, 0), [(2, ())]),
        (codes(1, 1, 0, 1, 1), [(1, ()), (2, ())]),
        (codes(0, 0, 0, 0, 0), []),
    ],
)
def test_the_joint_that_explains_the_codes_is_named(found, expected):
    assert [(s.joint, s.alternatives) for s in suspects(found, MOVING, NO_SHAPE)] == expected


def test_a_tie_names_the_others():
    (suspect,) = suspects(codes(1), np.array([[0, 1, 1]], dtype=np.int8), NO_SHAPE)
    assert (suspect.joint, suspect.alternatives) == (2, (3,))


def test_shape_breaks_a_tie():
    (suspect,) = suspects(codes(1), np.array([[0, 1, 1]], dtype=np.int8), np.array([0.0, 0.2, 0.9]))
    assert (suspect.joint, suspect.alternatives) == (3, ())


def test_an_interval_in_which_nothing_moves_blames_nobody():
    assert list(suspects(codes(1), np.zeros((1, 3), np.int8), NO_SHAPE)) == []


@given(st.integers(0, 2), st.lists(st.sampled_from([-1, 1]), min_size=5, max_size=5))
def test_one_faulty_joint_is_always_the_best_explanation_of_its_own_intervals(joint, signs):
    found = MOVING[:, joint] * np.array(signs, dtype=np.int8)
    assert suspects(found, MOVING, NO_SHAPE)[0].joint == joint + 1


def test_likeness():
    t = np.linspace(0, 1, 50)
    speed = np.sin(np.pi * t)
    assert likeness(25 * speed, speed, t) == pytest.approx(1.0)
    assert likeness(-40 * t, speed, t) == pytest.approx(1.0)
    assert likeness(np.sin(40 * t), speed, t) < 0.3
    assert likeness(np.zeros(50), speed, t) == 0.0
    assert likeness(np.ones(3), np.ones(3), np.ones(3)) == 0.0
