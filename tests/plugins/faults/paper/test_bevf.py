import numpy as np
import pytest
from bench.faults.printed import phase_18, power_17

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.paper.bevf import bode_response, fit, rms
from cellwatt_plugins.faults.paper.rational import Rational
from tests.plugins.faults.paper.irb1200 import PICK_AND_PLACE, Run, run
from tests.plugins.faults.paper.patterns import pattern_of

SOME = np.array([0.0, 2.0, 5.0])
"""s."""
PAIR = Rational(np.array([-0.4 + 2j, -0.4 - 2j]), np.array([6 + 3j, 6 - 3j]), 100.0)


@pytest.fixture(scope="module")
def task():
    return pattern_of(PICK_AND_PLACE)


def test_bode_gives_the_phase_of_a_response_of_least_phase():
    t = np.arange(0, 40, 0.01)
    truth = PAIR.at(1j * t)
    found = bode_response(np.abs(truth))
    assert np.abs(found) == pytest.approx(np.abs(truth), rel=1e-6)
    assert np.abs(np.angle(found) - np.angle(truth)).max() < 0.002


def test_equation_17_as_printed_by_hand():
    by_hand = np.sqrt(45) / np.sqrt((SOME - 2) ** 2 + 0.16) + np.sqrt(45) / np.sqrt((SOME + 2) ** 2 + 0.16) + 100
    assert power_17(PAIR, SOME) == pytest.approx(by_hand)


def test_equation_18_as_printed_by_hand():
    own = np.arctan(3 / 6) + np.arctan(-3 / 6)
    by_hand = own - np.arctan((SOME - 2) / 0.4) - np.arctan((SOME + 2) / 0.4) + np.arctan(100)
    assert phase_18(PAIR, SOME) == pytest.approx(by_hand)


def test_the_equation_kept_is_the_best_of_all_iterations(task):
    t, power = task
    equation = fit(t, power, order=34)
    assert len(equation.rms) == 12
    assert rms(power, equation.power(t)) == pytest.approx(min(equation.rms), rel=1e-9)
    assert equation.order == 34


def test_the_equation_holds_for_a_cycle_it_has_not_seen_and_between_its_samples(task):
    t, power = task
    equation = fit(t, power, order=44)
    other = run(Run(PICK_AND_PLACE, seed=77, noise=0.0))
    truth = other.power[: len(t)]
    assert rms(truth, equation.power(t)) < 1.0
    middle, between = (t[1:] + t[:-1]) / 2, (truth[1:] + truth[:-1]) / 2
    assert rms(between, equation.power(middle)) < 1.0


def test_rms_is_eq_19():
    assert rms(np.array([1.0, 2.0, 5.0]), np.array([1.0, 4.0, 4.0])) == pytest.approx(np.sqrt(5 / 3))


@pytest.mark.parametrize(
    ("count", "level", "order", "problem"),
    [
        (500, 100.0, 23, "even number"),
        (40, 100.0, 24, "needs more than 48 points"),
        (500, -5.0, 24, "above 0 W"),
    ],
)
def test_what_cannot_be_fitted_is_refused(count, level, order, problem):
    with pytest.raises(ModelError, match=problem):
        fit(np.arange(count) / 100, np.full(count, level), order=order)
