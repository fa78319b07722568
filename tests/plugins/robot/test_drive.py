from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.robot import Joint, RobotDescription
from cellwatt_plugins.robot.drive import TERMS, Drives, copper_loss, drawn, nominal_power

SHOULDER = Joint(name="shoulder", torque_constant=9.0, winding_resistance=0.8)
ELBOW = Joint(name="elbow", winding_resistance=0.5)  # without a torque constant its current is not known
ROBOT = RobotDescription(robot="planar", urdf=Path("arm.urdf"), joints=(SHOULDER, ELBOW), standby_power=40.0)

STATE = Drives.of(
    torque=np.array([[18.0, -6.0]]),
    qd=np.array([[0.5, -1.0]]),
    current=np.array([[2.0, -3.0]]),
    resistance=np.array([0.8, 0.5]),
)


TAKEN = {"mechanical": [9, 6], "copper": [3.2, 4.5], "switching": [2, 3], "eddy": [0.25, 1], "hysteresis": [0.5, 1]}


@pytest.mark.parametrize(("term", "expected"), TAKEN.items())
def test_what_a_drive_takes_from_the_bus(term, expected):
    np.testing.assert_allclose(TERMS[term](STATE), [expected])


def test_a_supply_draws_more_than_the_bus_takes_and_gets_back_less_than_it_gives():
    np.testing.assert_allclose(drawn(np.array([-10.0, 0.0, 10.0]), 1.25, 0.5), [-5.0, 0.0, 12.5])


def test_copper_loss_is_current_squared_times_resistance():
    loss = copper_loss(ROBOT, np.array([[18.0, 7.0], [-9.0, 0.0]]))
    np.testing.assert_allclose(loss, [[4 * 0.8, 0.0], [0.8, 0.0]])


def test_power_passes_the_converter_and_what_comes_back_is_shared():
    lossy = ROBOT.model_copy(update={"converter_efficiency": 0.8, "regeneration": 0.5})
    torque, qd = np.array([[18.0, 7.0], [-9.0, 2.0]]), np.array([[0.5, -1.0], [2.0, 0.0]])
    np.testing.assert_allclose(nominal_power(lossy, torque, qd), [40 + 5.2 / 0.8, 40 - 17.2 * 0.5])
