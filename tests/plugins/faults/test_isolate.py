import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_plugins.faults.isolate import suspects

MOVING = np.array([[1, 0, 0], [0, 1, 1], [0, 0, 1], [0, 1, 0], [1, 0, 1]], dtype=np.int8)


@given(st.integers(0, 2), st.lists(st.sampled_from([-1, 1]), min_size=5, max_size=5))
def test_one_faulty_joint_is_always_the_best_explanation_of_its_own_intervals(joint, signs):
    found = MOVING[:, joint] * np.array(signs, dtype=np.int8)
    assert suspects(found, MOVING, np.zeros(3))[0].joint == joint + 1
