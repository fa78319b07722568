from itertools import pairwise

import numpy as np

from cellwatt_plugins.faults.cycles.match import known_odds
from cellwatt_plugins.faults.cycles.runs import Run


def test_a_joint_that_is_right_again_has_no_wrong_encoder(known):
    """In task B at full speed; its four moves are those of joints 2 and 4, 1, 3 and 4, and all of them."""
    pattern = max((p for p in known.patterns if len(p.moves) == 4), key=lambda p: p.speed)
    poses = np.vstack([pattern.poses[0][:1], pattern.poses[1][:4]])
    poses[2, 3] += 0.1
    seen = [(m, run, run) for m, run in enumerate(Run(0, 1, a, b, (0 * a, 0 * b)) for a, b in pairwise(poses))]
    assert known_odds(seen, pattern, (3,)) == 0.0
