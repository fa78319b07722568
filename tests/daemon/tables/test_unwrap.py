import numpy as np
import pytest

from cellwatt.tables.unwrap import unwrapped, wraps

TIME = np.arange(0, 20, 0.02)
TURNING = 0.9 * TIME + 0.3 * np.sin(3 * TIME)
SWINGING = 0.4 * np.sin(2 * TIME)
WINDOWS = {"±180°": (-np.pi, np.pi), "0…360°": (0.0, 2 * np.pi)}


def modulo(angles, window):
    low, _ = WINDOWS[window]
    return low + np.mod(angles - low, 2 * np.pi)


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("true", [TURNING, -TURNING, SWINGING, SWINGING + np.pi])
def test_the_motion_is_what_it_was_but_for_whole_turns(true, window):
    found = unwrapped(modulo(true, window))
    turns = (found - true) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)


def test_the_middle_is_within_half_a_turn():
    assert abs(np.median(unwrapped(modulo(SWINGING, "0…360°")))) < 0.1


def test_missing_values_stay_missing_and_hide_no_turn():
    angles = modulo(TURNING, "±180°")
    at = wraps(angles)
    angles[at[0] - 2 : at[0] + 3] = np.nan
    found = unwrapped(angles)
    assert np.isnan(found[at[0]])
    known = np.isfinite(found)
    turns = (found - TURNING)[known] / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)


class Counted(np.ndarray):
    """Angles that count the values taken from them."""

    taken = 0

    def __getitem__(self, key):
        found = super().__getitem__(key)
        Counted.taken += np.size(found)
        return found


def test_angles_that_flicker_across_the_jump_are_unwrapped_in_one_pass():
    angles = np.mod(np.random.default_rng(0).normal(0, 1e-5, 10_000), 2 * np.pi)
    angles[:10] += 1e-3 * np.arange(10)
    assert np.ptp(unwrapped(angles.view(Counted))) < 0.02
    assert Counted.taken < 10 * len(angles)


@pytest.mark.parametrize(
    "angles",
    [
        TURNING,
        SWINGING,
        np.degrees(modulo(TURNING, "0…360°")),
        np.random.default_rng(0).uniform(-np.pi, np.pi, 100),
        np.where(TIME < 10, 0.0, 4.5) + 0.01 * np.sin(TIME),
        np.full(5, np.nan),
        np.zeros(0),
        np.array([0.0, 6.28]),
    ],
    ids=["counted on", "swinging", "degrees", "poses", "a jump that is no turn", "nothing", "empty", "two poses"],
)
def test_what_is_not_modulo_a_turn_stays(angles):
    assert len(wraps(angles)) == 0
    np.testing.assert_array_equal(unwrapped(angles), angles)
