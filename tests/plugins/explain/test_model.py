from dataclasses import replace

import numpy as np
import pytest
import yaml

from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.model import FittedTerm, Model, Retuned, load_model, save_model
from cellwatt_plugins.robot.effects import BY_NAME
from tests.plugins.explain import plant

MASS, REACH = 1.7, 0.3


@pytest.fixture(scope="module")
def motion():
    time = np.arange(600) / plant.RATE
    return time, *plant.moves(5, 6.0)(time)


def inertial(arm):
    """Of the two moving links; link 1 has only its column."""
    return np.ravel([np.zeros(10), plant.inertial(arm, 0), plant.inertial(arm, 1)])


def difference(new, old):
    """What retuning must add to one arm's numbers to have another's."""
    off = {name: np.subtract(getattr(new, name), getattr(old, name)) for name in ("coulomb", "viscous", "rotor")}
    return Retuned(
        inertial(new) - inertial(old),
        off["coulomb"],
        off["viscous"],
        off["rotor"],
        new.standby - old.standby,
        np.divide(new.resistance, old.resistance) - 1,
    )


def term(name, joint, shape, coefficients):
    return FittedTerm(Term(BY_NAME[name], joint, tuple(shape)), np.array(coefficients, float))


PAYLOAD = term("payload", None, (), [MASS, MASS * REACH, 0, 0, 0, 0, MASS * REACH**2, 0, 0, MASS * REACH**2])
TERMS = (
    PAYLOAD,
    term("stribeck_friction", 1, (0.2,), [4.0]),
    term("spring_load", 2, (), [12.0, -3.0]),
    term("torque_gain", 0, (), [0.07]),
    term("time_delay", None, (0.013,), [1.0]),
    term("joint_elasticity", 0, (3000.0, 12.0, 0.0), [1.0, 0.9, 0.8]),
    term("fan_switching", None, (1.0, 2.0, 3.0), [30.0]),
    term("converter_efficiency", None, (0.0,), [0.2]),
)


def test_the_nominal_model_is_the_simulation(arm, motion):
    said = plant.predict(Model(Baseline(arm, arm), Retuned.nothing(plant.JOINTS)), *motion)
    torque = plant.motors(plant.NOMINAL, *motion[1:])
    assert np.allclose(said.torque, torque, atol=1e-9)
    assert np.allclose(said.power, plant.draw(plant.NOMINAL, torque, motion[2]), atol=1e-7)
    assert np.array_equal(said.time, motion[0])


def test_a_retuned_model_is_the_arm_as_it_was_built(arm, motion):
    real = replace(plant.REAL, resistance=(0.66, 0.57, 1.2))
    said = plant.predict(Model(Baseline(arm, arm), difference(real, plant.NOMINAL)), *motion)
    torque = plant.motors(real, *motion[1:])
    assert np.allclose(said.torque, torque, atol=1e-9)
    assert np.allclose(said.power, plant.draw(real, torque, motion[2]), atol=1e-6)


def test_a_model_says_the_same_after_its_file(arm, motion, tmp_path):
    simulated = arm.with_parameters(1.01 * arm.body.parameters()).with_gravity(np.array([0.0, 0.1, -9.8]))
    recorded = simulated.with_gravity(np.array([9.8, 0.0, 0.1])).with_friction_lead(0.01)
    recorded = recorded.with_coupling(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.5, 1.0]]))
    model = Model(Baseline(simulated, recorded), difference(plant.REAL, plant.NOMINAL), TERMS)
    (tmp_path / "robot.urdf").write_text("another arm's")
    save_model(model, tmp_path / "model.yaml")
    again = load_model(tmp_path / "model.yaml")
    assert (tmp_path / "robot.urdf").read_text() == "another arm's"
    assert again.terms[1].term == model.terms[1].term
    assert [f.term.place for f in again.terms] == [f.term.place for f in model.terms]
    before, after = plant.predict(model, *motion), plant.predict(again, *motion)
    assert np.array_equal(before.torque, after.torque)
    assert np.array_equal(before.power, after.power)


def damaged(folder, arm, change):
    save_model(Model(Baseline(arm, arm), Retuned.nothing(plant.JOINTS), TERMS), folder / "model.yaml")
    content = yaml.safe_load((folder / "model.yaml").read_text())
    change(content)
    (folder / "model.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError) as caught:
        load_model(folder / "model.yaml")
    message = str(caught.value)
    assert "\n" not in message
    assert "model.yaml" in message
    return message


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: c["robot"].pop("joints"), "robot: the key 'joints' is missing"),
        (lambda c: c["retuned"].update(standby_power="much"), "standby_power: found 'much', expected a number"),
        (lambda c: c["retuned"]["inertial"].pop(), "retuned.inertial: found the shape (29,), expected (30,)"),
        (lambda c: c.update(coupling=[[1.0, 0.0, 0.0]]), "coupling: found the shape (1, 3), expected (3, 3)"),
        (lambda c: c["effects"][0].update(effect="phlogiston"), "'phlogiston'"),
        (lambda c: c["effects"][0].update(joint=0), "the robot has the joints 1 to 3"),
    ],
)
def test_a_damaged_model_is_said_in_one_line(arm, tmp_path, change, said):
    assert said in damaged(tmp_path, arm, change)
