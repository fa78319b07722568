"""What the plant has and the simulation lacks is found in its recordings, and nothing where nothing is."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.explain.report.terminal import in_words
from tests.plugins.explain import calling, plant
from tests.plugins.explain.plant import REAL, Missing, column, loaded, turned
from tests.plugins.robot.slow_meter import shown


@dataclass(frozen=True)
class Expected:
    """What must be found, and the true numbers of it."""

    missing: Missing
    effect: str
    joint: int | None
    truth: dict[str, float]


SINGLE = {
    "friction": Expected(
        Missing(added=lambda t, q, qd, run: column(4 * np.exp(-((qd[:, 1] / 0.15) ** 2)) * turned(qd[:, 1]), 2)),
        "stribeck_friction",
        2,
        {"excess": 4.0, "velocity": 0.15},
    ),
    "payload": Expected(
        Missing(arm=loaded(REAL, 2.0, 0.12)), "payload", None, {"mass": 2.0, "com_x": 0.12, "com_z": 0.0}
    ),
    "contact": Expected(
        Missing(added=lambda t, q, qd, run: column((run == "run_01") * 20 * np.exp(-0.5 * ((t - 9) / 0.2) ** 2), 2)),
        "external_contact",
        2,
        {"torque": 20.0, "time": 9.0, "width": 0.2},
    ),
    "supply": Expected(
        Missing(drawn=lambda t, power, qd: REAL.standby + (power - REAL.standby) / 0.86),
        "converter_efficiency",
        None,
        {"efficiency": 0.86},
    ),
}


@pytest.fixture(scope="module")
def explained(arm):
    return cache(
        lambda missing: calling.explained(arm, [plant.record(f"run_0{seed}", seed, missing) for seed in (1, 2)])
    )


def test_a_simulation_that_is_only_mistuned_lacks_nothing(explained):
    found = explained(plant.NOTHING).findings
    assert found.verdict == "no_mismatch"
    assert found.findings == ()
    assert found.unexplained == ()
    for fit in found.fit:
        assert fit.model == pytest.approx(fit.noise_floor, rel=0.25)
        assert fit.model <= fit.simulation * 1.02


@pytest.mark.parametrize("name", SINGLE)
def test_one_effect_is_found_alone_with_its_numbers(explained, name):
    expected = SINGLE[name]
    found = explained(expected.missing).findings
    assert [(f.effect, f.joint) for f in found.findings] == [(expected.effect, expected.joint)]
    assert found.verdict == "explained"
    (finding,) = found.findings
    assert finding.kind == "missing"
    assert finding.confidence > 0.5
    for key, value in expected.truth.items():
        parameter = finding.parameters[key]
        # 1 % more: errors of the fitted torque (power) and the smoothed motion (delay) are not in the deviation.
        assert abs(parameter.value - value) < 4 * parameter.std + 0.01 * abs(value), key
        assert parameter.std < 0.5 * max(abs(value), 0.1), key


def test_two_effects_at_two_joints_are_both_found(explained):
    both = Missing(
        added=lambda t, q, qd, run: column(30 * (q[:, 1] + 0.3), 2),
        read=lambda torque: torque + np.array([0, 0, 1.5]),
    )
    found = {(f.effect, f.joint): f for f in explained(both).findings.findings}
    assert set(found) == {("spring_load", 2), ("torque_offset", 3)}
    stiffness = found["spring_load", 2].parameters["stiffness"]
    assert abs(stiffness.value - 30) < 4 * stiffness.std
    offset = found["torque_offset", 3].parameters["offset"]
    assert abs(offset.value - 1.5) < 4 * offset.std


def test_the_push_is_placed_in_time(explained):
    found = explained(SINGLE["contact"].missing)
    (finding,) = found.findings.findings
    (span,) = finding.where.times
    assert f"In run_01 {span.start:.1f} to {span.end:.1f} s." in in_words(found, Path("out"), report=False)
    assert span.recording == "run_01"
    assert span.start < 9.0 < span.end
    assert span.end - span.start < 2.0


@pytest.mark.parametrize("name", ["friction", "payload", "supply"])
def test_the_model_predicts_a_run_that_it_has_not_seen(explained, name):
    """Against the plant without noise; the simulation alone is several times worse."""
    expected = SINGLE[name]
    model = explained(expected.missing).model
    time = np.arange(2000) / plant.RATE
    q, qd, qdd = plant.moves(77, 20.0)(time)
    said = plant.predict(model, time, q, qd, qdd)
    torque = plant.motors(expected.missing.arm, q, qd, qdd) + expected.missing.added(time, q, qd, "run_09")
    power = expected.missing.drawn(time, plant.draw(expected.missing.arm, torque, qd), qd)
    simulated = plant.motors(plant.NOMINAL, q, qd, qdd)
    if name == "supply":
        before = np.std(plant.draw(plant.NOMINAL, simulated, qd) - power)
        assert np.std(said.power - power) < 0.25 * before
    else:
        before = np.std((simulated - torque)[:, 1])
        assert np.std((said.torque - torque)[:, 1]) < 0.25 * before


def test_what_the_supply_lacks_is_found_through_a_slow_meter(arm):
    """A meter of five values a second."""
    runs = [plant.record(f"run_0{seed}", seed, SINGLE["supply"].missing) for seed in (1, 2)]
    runs = [replace(run, power=shown(run.time, run.power, 0.2, 0.15)) for run in runs]
    (one,) = calling.explained(arm, runs).findings.findings
    assert one.effect == "converter_efficiency"
    assert one.parameters["efficiency"].value == pytest.approx(0.86, abs=0.02)


def test_runs_without_power_leave_the_supply_out_and_say_so(arm):
    found = calling.explained(arm, [plant.record("run_01", 1, power=False)])
    assert found.supply is None
    assert found.findings.verdict == "no_mismatch"
    assert [fit.channel for fit in found.findings.fit] == ["tau_1", "tau_2", "tau_3"]
    assert any("power" in note for note in found.findings.notes)
