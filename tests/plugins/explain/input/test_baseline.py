"""What recordings are compared with: the numbers of a simulation whose law the tests write themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.explain.input.baseline import baseline
from cellwatt_plugins.explain.input.run import Run
from tests.plugins.explain import plant
from tests.plugins.explain.calling import explained
from tests.plugins.explain.input.reading import examine

HEAVIER = plant.loaded(plant.NOMINAL, 1.6, 0.3)


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    """The arm as its description has it."""
    return plant.load(plant.write_robot(tmp_path_factory.mktemp("described")))


@pytest.fixture(scope="module")
def silent(tmp_path_factory):
    """A description that knows links alone."""
    nothing = {"coulomb_friction": 0.0, "viscous_friction": 0.0, "rotor_inertia": 0.0, "winding_resistance": 0.0}
    return plant.load(plant.write_robot(tmp_path_factory.mktemp("silent"), **nothing, standby_power=0.0))


def run(simulated, name="run"):
    """A recording that follows its plan exactly."""
    plan = simulated.plan
    return Run(
        name, simulated.time, plan.position, None, simulated.torque, simulated.power, plan=plan, simulated=simulated
    )


TIME = np.arange(2400) / plant.RATE


def test_without_a_simulation_it_is_the_description(described):
    bare = replace(run(plant.simulated(plant.moves(1, 24.0), TIME)), simulated=None)
    base = baseline([bare], described)
    assert base.arm == described
    assert base.beyond(bare) == (None, None)


def turned_early(lead):
    """Nm that friction which turns over so many s early has more, as MuJoCo's soft friction does."""
    _, qd, qdd = plant.moves(1, 24.0)(TIME)
    return np.array(plant.NOMINAL.coulomb) * (np.tanh((qd + lead * qdd) / 0.004) - np.tanh(qd / 0.004))


@pytest.mark.parametrize("lead", [0.0, 0.0095])
def test_friction_that_turns_over_early_is_found_in_the_simulation(silent, lead):
    base = baseline([run(plant.simulated(plant.moves(1, 24.0), TIME, more=turned_early(lead)))], silent)
    assert base.arm.description.friction_lead == pytest.approx(lead, abs=0.001)


def test_an_arm_whose_friction_turns_with_its_velocity_has_no_lead(silent):
    early = turned_early(0.0095)
    simulated = run(plant.simulated(plant.moves(1, 24.0), TIME, more=early))
    arm = replace(simulated, torque=simulated.torque - early)
    base, _ = examine([simulated], silent)
    assert base.recorded is base.arm
    assert examine([arm], silent)[0].recorded.description.friction_lead == 0.0


def test_numbers_that_the_description_lacks_are_the_simulations(silent):
    runs = [run(plant.simulated(plant.moves(seed, 24.0), TIME)) for seed in (1, 2)]
    base = baseline(runs, silent)
    for name in ("coulomb", "viscous", "rotor", "resistance"):
        key = {"coulomb": "coulomb_friction", "viscous": "viscous_friction", "rotor": "rotor_inertia"}
        found = [getattr(joint, key.get(name, "winding_resistance")) for joint in base.arm.description.joints]
        assert found == pytest.approx(getattr(plant.NOMINAL, name), rel=0.02), name
    assert base.arm.description.standby_power == pytest.approx(plant.NOMINAL.standby, rel=0.01)
    torque, power = base.beyond(runs[0])
    assert np.sqrt(np.mean(torque**2)) < 0.05
    assert np.sqrt(np.mean(power**2)) < 0.5


def test_a_tool_that_the_urdf_lacks_is_carried_to_other_motion(silent):
    """The links found from one motion say what the tool needs in another."""
    runs = [run(plant.simulated(plant.moves(seed, 24.0), TIME, HEAVIER)) for seed in (1, 2)]
    base = baseline(runs, silent)
    q, qd, qdd = plant.moves(9, 10.0)(TIME[:1000])
    clear = np.all((np.abs(qd) > 0.05) | (qd == 0), axis=1)
    wanted = plant.motors(HEAVIER, q, qd, qdd)
    off = (base.arm.torque(q, qd, qdd) - wanted)[clear]
    assert np.all(np.sqrt(np.mean(off**2, axis=0)) < 0.02 * np.std(wanted, axis=0))
    assert np.all(np.abs(silent.body.parameters() - base.arm.body.parameters()).reshape(-1, 10)[2, 0] > 0.5)


def test_the_simulations_torque_is_what_is_explained(described):
    """Another torque of the simulation makes another answer."""
    seen = plant.record("run", 3)
    assert seen.simulated is not None
    other = replace(seen, simulated=replace(seen.simulated, torque=seen.simulated.torque + np.array([0.0, 5.0, 0.0])))
    off = explained(described, [other]).findings
    assert [(f.effect, f.joint) for f in off.findings if f.kind == "missing"] == [("torque_offset", 2)]
    assert off.findings[0].parameters["offset"].value == pytest.approx(-5.0, abs=0.3)


def test_where_the_description_says_otherwise_is_one_note(silent):
    seen = plant.record("run", 3)
    _, notes = examine([seen], silent)
    (note,) = [n for n in notes if "differs from the simulation" in n]
    assert "joint 1" in note
    assert "Coulomb friction 0 instead of" in note
    assert "the supply by" in note
