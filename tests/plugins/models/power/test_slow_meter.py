"""A model trained on ten values of power a second, each a mean and late, beside one trained on power as it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.shown import Shown, through_its_meter
from cellwatt_plugins.models.power.training import estimate
from tests.plugins.models.power.cases import model_of, read_case
from tests.plugins.robot.slow_meter import shown

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return read_case(tmp_path_factory.mktemp("case"), "six axes", 7, moves=20, unseen=4)


def slow(moves: Moves, window: float, late: float) -> Moves:
    """With power from a slow meter that meets each move elsewhere."""
    power = moves.power.copy()
    for number, (a, b) in enumerate(moves.bounds()):
        power[a:b] = shown(moves.time[a:b], power[a:b], window, late, phase=number * 0.37 % 1)
    return replace(moves, power=power)


@pytest.mark.slow  # two trainings
def test_the_meter_costs_little(case):
    arm, known, unseen = case
    errors = []
    for moves in (known, slow(known, 0.1, 0.15)):
        power, _ = estimate(model_of(moves, arm), unseen, arm)
        score = Score.of(unseen, power, unseen.current)
        errors.append((score.power, score.energy_mean))
    (fast, fast_energy), (metered, metered_energy) = errors
    assert metered < 1.25 * fast
    assert metered_energy < fast_energy + 0.1


def test_the_meter_is_found_and_what_it_shows_is_compared(case):
    arm, known, _ = case
    moves = through_its_meter(slow(known, 0.2, 0.3), arm)
    assert moves.meter is not None
    assert moves.meter.window == pytest.approx(0.2, abs=0.01)
    assert moves.meter.late == pytest.approx(0.3, abs=0.01)
    # Power as it really was leaves only the noise of the means, though values held for 0.2 s are far from it.
    score = Score.of(moves, known.power, known.current)
    held = np.std(moves.power - known.power)
    assert score.power < 0.1 * held
    assert score.energy_worst < 1
    half = moves.only(range(10))
    assert half.meter == moves.meter
    assert through_its_meter(known, arm) is known, "power at the rate of the rows has no slow meter"


def test_a_move_may_be_too_short_for_a_value_of_the_meter(case):
    arm, known, _ = case
    moves = through_its_meter(slow(known, 0.2, 0.3), arm)
    first = int(np.flatnonzero(np.isfinite(moves.came))[0])
    brief = moves.where(np.arange(len(moves)) < first)
    shown = Shown.of(brief, np.arange(first))
    assert not len(shown.power)
    assert shown.seen(brief.q).shape == (0, brief.joints)


def test_power_that_does_not_follow_the_motion_is_refused(case):
    arm, known, _ = case
    other = np.random.default_rng(3).normal(100, 20, len(known))
    with pytest.raises(RecordingError, match=r"every 0\.1 s, and the motion does not show"):
        through_its_meter(slow(replace(known, power=other), 0.1, 0.15), arm)
