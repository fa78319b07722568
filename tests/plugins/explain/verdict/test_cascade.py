"""What each finding takes off the error, and numbers that moved, against a plant whose numbers are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.solve import fitted
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.verdict.cascade import cascade, falling
from cellwatt_plugins.explain.verdict.retuned import retuned_of
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.effects import EFFECTS
from tests.plugins.explain import plant
from tests.plugins.explain.plant import NOMINAL, Missing

OFFSETS = np.array([0.0, 0.9, 1.5])
(OFFSET,) = [effect for effect in EFFECTS if effect.name == "torque_offset"]


def solution(arm: Arm, missing: Missing, *terms: Term) -> Solution:
    return fitted(plant.problem_of(arm, missing, 12.0), terms)


def test_each_step_takes_off_what_was_put_in_and_the_largest_comes_first(arm: Arm) -> None:
    missing = Missing(arm=NOMINAL, read=lambda torque: torque + OFFSETS)
    fall = falling(solution(arm, missing, Term(OFFSET, 1, ()), Term(OFFSET, 2, ())))
    first, second, third, last = cascade([fall], None)
    assert [(s.kind, s.joint) for s in (first, second, third, last)] == [
        ("simulation", None),
        ("finding", 3),
        ("finding", 2),
        ("retuning", None),
    ]
    own = np.hypot(OFFSETS, plant.TORQUE_NOISE)
    assert list(first.channels.values()) == pytest.approx(own, rel=0.06)
    assert second.channels["tau_3"] == pytest.approx(plant.TORQUE_NOISE[2], rel=0.1)
    assert second.channels["tau_2"] == pytest.approx(first.channels["tau_2"], rel=1e-3)
    assert third.channels["tau_2"] == pytest.approx(plant.TORQUE_NOISE[1], rel=0.1)
    assert first.error > second.error > third.error
    assert last.error == pytest.approx(1.0, abs=0.15)


def test_a_mount_is_the_first_step(arm: Arm) -> None:
    fall = falling(solution(arm, Missing(arm=NOMINAL)))
    before, mounted, retuned = cascade([fall], np.array([3.0, 4.0, 5.0]))
    assert list(before.channels.values()) == [3.0, 4.0, 5.0]
    assert mounted.effect == "gravity_tilt"
    assert list(mounted.channels.values()) == pytest.approx(fall.simulation)
    assert retuned.kind == "retuning"


def test_friction_that_retuning_absorbs_is_told_with_its_numbers(arm: Arm) -> None:
    real = replace(NOMINAL, coulomb=(5.0, 7.0, 4.0))
    found = solution(arm, Missing(arm=real))
    told = {(r.parameter, r.joint): r for r in retuned_of(found, falling(found))}
    friction = told["coulomb_friction", 3]
    assert (friction.was, friction.unit) == (3.0, "N*m")
    assert friction.now == pytest.approx(4.0, abs=max(3 * friction.std, 0.05))
    assert friction.tolerance == pytest.approx(0.3)
    assert "joint 3" in friction.statement
    assert "explains most of joint 3" in friction.statement


def test_mass_that_retuning_absorbs_is_told_with_the_joints_that_it_explains(arm: Arm) -> None:
    found = solution(arm, Missing(arm=replace(NOMINAL, masses=(7.5, 4.7))))
    (mass,) = [r for r in retuned_of(found, falling(found)) if r.parameter == "mass"]
    assert (mass.joint, mass.was, mass.unit) == (3, 4.2, "kg")
    assert mass.now == pytest.approx(4.7, abs=2 * mass.std)
    assert mass.statement.startswith("Link 3 is ")
    assert "heavier than in your simulation" in mass.statement
    assert "joint 2 (" in mass.statement
