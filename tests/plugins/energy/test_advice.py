"""Advice followed on the plant: what it said would be saved is saved."""

from dataclasses import replace

import numpy as np
import pytest
from energy.live import RATE
from energy.plant import production

from cellwatt_plugins.energy.advice import Cycle, advise, motion_energy, speed_advice
from cellwatt_plugins.energy.task_energy import Stretch, stored_energy

PAUSE = 2.0


def produced(measured, speed):
    case, _, key = measured
    seen, power, _ = production(case, key["fixed"], speed, 5.0, 1, PAUSE, RATE)
    return Stretch(1 / RATE, seen["position"], seen["velocity"], seen["torque"], power)


def part_of(whole, first, end):
    names = ("position", "velocity", "torque", "power")
    return Stretch(whole.step, *(getattr(whole, name)[first:end] for name in names))


def moving(whole):
    return part_of(whole, round(PAUSE * RATE), len(whole.power) - round(PAUSE * RATE))


def test_the_energy_of_another_speed_is_what_the_arm_then_takes(measured, arm_and_known):
    """The same path at half the speed, as the plant measures it."""
    fast, slow = moving(produced(measured, 400.0)), moving(produced(measured, 200.0))
    scale = len(slow.power) / len(fast.power)
    said = motion_energy(*arm_and_known, fast, scale)
    assert said == pytest.approx(slow.power.sum() / RATE, rel=0.02)
    assert motion_energy(*arm_and_known, fast, 1.0) == pytest.approx(fast.power.sum() / RATE, rel=0.01)


def test_slower_in_the_same_cycle_time_saves_as_much_as_it_said(measured, arm_and_known):
    fast = moving(produced(measured, 1400.0))
    seconds = len(fast.power) / RATE
    advice = speed_advice(*arm_and_known, Cycle(fast, 3.0))
    assert advice.kind == "slower"
    # Replayed: twice as long, waiting for as much less.
    twice = moving(produced(measured, 1400.0 * seconds / (seconds + 1.5)))
    rest = produced(measured, 400.0).power[: round(RATE)].mean()
    cycle = fast.power.sum() / RATE + 3.0 * rest
    slower = twice.power.sum() / RATE + (3.0 + seconds - len(twice.power) / RATE) * rest
    assert cycle - slower > 0
    assert advice.saving >= 0.9 * (cycle - slower)  # the best speed saves at least what this one does
    assert advice.saving < cycle - seconds * measured[2]["fixed"]["controller"]


def test_faster_where_the_next_cycle_follows_at_once(measured, arm_and_known):
    slow = moving(produced(measured, 150.0))
    advice = speed_advice(*arm_and_known, Cycle(slow, 0.0))
    assert advice.kind == "faster"
    faster = moving(produced(measured, 300.0))
    assert advice.saving > 0.9 * (slow.power.sum() - faster.power.sum()) / RATE > 0


def test_brakes_save_their_power_and_the_holding(measured, arm_and_known):
    fast = moving(produced(measured, 400.0))
    found = {advice.kind: advice for advice in advise(*arm_and_known, Cycle(fast, 60.0), brake_time=2.0)}
    hold = produced(measured, 400.0).power[: round(2 * RATE)].mean() - sum(measured[2]["fixed"].values())
    true = 58.0 * (measured[2]["fixed"]["brakes"] + hold)
    assert found["brakes"].saving == pytest.approx(true, rel=0.05, abs=3 * found["brakes"].uncertainty)
    assert not [a for a in advise(*arm_and_known, Cycle(fast, 1.0), brake_time=2.0) if a.kind == "brakes"]


def waiting(measured, speed):
    """The motion, a rest with the brakes released, and one with the brakes on."""
    whole, fixed = produced(measured, speed), measured[2]["fixed"]
    rest = part_of(whole, 0, round(1.5 * RATE))
    electronics = np.full_like(rest.power, fixed["controller"] + fixed["robot_electronics"])
    return moving(whole), rest, replace(rest, torque=0 * rest.torque, power=electronics)


def test_an_arm_that_waits_with_its_brakes_on_is_not_told_to(measured, arm_and_known):
    fast, *rests = waiting(measured, 400.0)
    told = [{a.kind for a in advise(*arm_and_known, Cycle(fast, 60.0, rest), brake_time=2.0)} for rest in rests]
    assert ["brakes" in kinds for kinds in told] == [True, False]


def test_slower_saves_less_where_the_arm_waits_with_its_brakes_on(measured, arm_and_known):
    """The saving of a waiting arm whose brakes are on is that of its motion less the power at rest with brakes on."""
    fast, *rests = waiting(measured, 1400.0)
    seconds = len(fast.power) / RATE
    for rest in rests:
        advice, power = speed_advice(*arm_and_known, Cycle(fast, 3.0, rest)), float(rest.power.mean())
        longer = advice.setting["motion_s"]
        now = motion_energy(*arm_and_known, fast, 1.0) + 3.0 * power
        then = motion_energy(*arm_and_known, fast, longer / seconds) + (3.0 + seconds - longer) * power
        assert advice.saving == pytest.approx(now - then, abs=1.0)


def test_an_open_path_stores_what_it_lifts(measured, arm_and_known):
    arm, _ = arm_and_known
    whole = moving(produced(measured, 400.0))
    part = part_of(whole, 0, len(whole.power) // 3)
    torque = arm.body.inverse_dynamics(part.position, part.velocity, np.gradient(part.velocity, 1 / RATE, axis=0))
    work = np.trapezoid((torque * part.velocity).sum(axis=1), dx=1 / RATE)
    assert stored_energy(arm, part) == pytest.approx(work, abs=0.5)
    assert abs(stored_energy(arm, whole)) < 0.01


def test_no_joint_is_advised_beyond_its_own_velocity(measured, arm_and_known):
    arm, known = arm_and_known
    slow = moving(produced(measured, 150.0))
    tops = np.abs(slow.velocity).max(axis=0)
    least = int(np.argmin(tops))
    joints = [
        joint.model_copy(update={"velocity_limit": float(top) if i == least else 100.0})
        for i, (joint, top) in enumerate(zip(arm.description.joints, tops, strict=True))
    ]
    limited = replace(arm, description=arm.description.model_copy(update={"joints": tuple(joints)}))
    advice = speed_advice(limited, known, Cycle(slow, 0.0))
    assert advice.setting["motion_s"] >= len(slow.power) / RATE
