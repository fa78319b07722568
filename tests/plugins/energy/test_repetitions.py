from itertools import pairwise

import numpy as np
import pytest
from energy.plant import _timing

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.recordings import RobotTrace
from cellwatt_plugins.energy.repetitions import find_repetitions

NOISE = 2e-5
RATE = 100.0


def motion(profile, legs, seconds):
    """Closed paths of three legs each, a rest of 1 s between them; begins 3.7 ms after a sample."""
    fine = 1e-3
    points = np.array([[0.2, 0.9], [0.6, 0.6], [0.3, 1.5], [0.2, 0.9]])
    still = np.tile(points[:1], (1000, 1))
    parts, starts, at = [still], [], len(still)
    for length in legs:
        count = round(length * seconds / fine)
        starts.append((at * fine, (at + 3 * count) * fine))
        s = _timing(profile, np.linspace(0, 1, count + 1)[1:])[:, None]
        parts += [*(a + (b - a) * s for a, b in pairwise(points)), still]
        at += 3 * count + len(still)
    q = np.vstack(parts)
    time = np.arange(0.0037, len(q) * fine - fine, 1 / RATE)
    grid = np.arange(len(q)) * fine
    seen = np.stack([np.interp(time, grid, column) for column in q.T], axis=1)
    seen += np.random.default_rng(1).normal(0, NOISE, seen.shape)
    return RobotTrace("run", time, seen, np.gradient(seen, 1 / RATE, axis=0), seen), starts


@pytest.mark.parametrize(("profile", "seconds"), [("quintic", 0.4), ("septic", 1.5), ("trapezoid", 6.0)])
def test_lengths_are_found_within_a_percent(profile, seconds):
    recorded, true = motion(profile, [1, 1, 1], seconds)
    found, notes = find_repetitions(recorded)
    assert len(found) == 3
    assert not notes
    for repetition, (start, end) in zip(found, true, strict=True):
        assert repetition.seconds == pytest.approx(end - start, rel=0.011)
        assert repetition.start == pytest.approx(start, abs=0.006 * (end - start) + 0.01)


def test_an_interrupted_repetition_is_left_out_and_named():
    recorded, _ = motion("quintic", [1, 1.3, 1], 2.0)
    found, notes = find_repetitions(recorded)
    assert len(found) == 2
    assert len(notes) == 1
    assert "took 7.8" in notes[0]


def test_no_repetition_says_what_to_do():
    recorded, _ = motion("quintic", [1], 2.0)
    keep = recorded.time < 4.0
    columns = (recorded.time, recorded.position, recorded.velocity, recorded.torque)
    cut = RobotTrace("run", *(column[keep] for column in columns))
    with pytest.raises(RecordingError, match="record from rest to rest"):
        find_repetitions(cut)


def test_repetitions_that_all_took_another_time_are_refused():
    with pytest.raises(RecordingError, match=r"took 6\.0\d, 8\.4\d s: which was interrupted"):
        find_repetitions(motion("quintic", [1, 1.4], 2.0)[0])
