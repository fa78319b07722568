from itertools import pairwise

import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.match import known_odds
from cellwatt_plugins.faults.cycles.runs import Run

BY_SCALE, BY_OFFSET, STUCK, ONE_POSE = "scale", "offset", "stuck", "one pose"


@pytest.fixture(scope="module")
def pattern(known):
    """Task B at full speed: its four moves are those of joints 2 and 4, 1, 3 and 4, and all of them."""
    return max((p for p in known.patterns if len(p.moves) == 4), key=lambda p: p.speed)


def seen(pattern, moves, joint, how):
    """The runs of so many moves, with an encoder that is wrong or a joint that is once elsewhere."""
    poses = np.vstack([pattern.poses[0][:1], pattern.poses[1][:moves]])
    shown = poses[:, joint].copy()
    if how == BY_SCALE:
        shown = shown[0] + 1.2 * (shown - shown[0])
    elif how == BY_OFFSET:
        shown += 0.1
    elif how == STUCK:
        shown[1:] = shown[0] + 0.6 * (shown[1] - shown[0])
    else:
        shown[2] += 0.1
    poses[:, joint] = shown
    return [(m, run, run) for m, run in enumerate(Run(0, 1, a, b) for a, b in pairwise(poses))]


def test_a_joint_that_is_right_again_has_no_wrong_encoder(pattern):
    assert known_odds(seen(pattern, 4, 3, ONE_POSE), pattern, (3,)) == 0.0
