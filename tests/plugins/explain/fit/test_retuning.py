"""Retuned numbers that data left out do not confirm stay the user's."""

from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.problem import Problem
from cellwatt_plugins.explain.fit.retuning import FIXED, confirmed, freed, looseness
from cellwatt_plugins.robot.body import PER_LINK
from tests.plugins.explain import plant

FACTOR = np.full(plant.JOINTS, 2.0)


def problem(arm, real: plant.Arm) -> Problem:
    return plant.problem_of(arm, plant.Missing(arm=real), 20.0)


def free(problem: Problem, factors: np.ndarray) -> tuple[set[int], set[int]]:
    """Links, and joints of friction and rotors, that may differ from the description (1-based)."""
    asked = factors > FIXED
    own = {
        (b.channel or 0) + 1 for b, f in zip(problem.nuisance[plant.JOINTS :], asked[plant.JOINTS :], strict=True) if f
    }
    return {link + 1 for link in range(plant.JOINTS) if asked[link]}, own


def test_an_arm_exactly_as_described_keeps_all_its_numbers(arm):
    exact = problem(arm, plant.NOMINAL)
    assert free(exact, confirmed(exact, [], FACTOR)) == (set(), set())


def test_the_joint_whose_friction_is_off_is_retuned_alone(arm):
    off = problem(arm, replace(plant.NOMINAL, coulomb=(5.5, 7.0, 3.0), viscous=(8.8, 9.0, 4.0)))
    factors = confirmed(off, [], FACTOR)
    assert free(off, factors) == (set(), {1})
    own = freed(off, factors)
    fit = own.fit([], FACTOR)
    told = [
        float(fit.coefficients[place][0])
        for block, place in zip(own.nuisance, own.design.slices, strict=True)
        if block.channel == 0 and block.size == 1
    ]
    # Of Coulomb and viscous friction, 10 % of 5 Nm and of 8 Nm s/rad.
    assert any(value == pytest.approx(0.5, abs=0.1) for value in told)
    assert any(value == pytest.approx(0.8, abs=0.15) for value in told)


@pytest.mark.parametrize(("factor", "loose"), [(1.0, False), (1.8, True)])
def test_links_that_are_much_further_off_than_said_get_more_tolerance(arm, factor, loose):
    """Where what is left is one slow course, as on real arms, so that samples count little against tolerances."""
    masses = tuple(factor * m for m in plant.REAL.masses)
    heavy = problem(arm, replace(plant.REAL, masses=masses))
    assert (looseness(heavy, [], np.full(plant.JOINTS, 1000.0)) > 1) == loose
    assert len(heavy.design.blocks[0].prior.mean) == PER_LINK
