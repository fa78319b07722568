"""What the demo says of its arm's energy is what is emulated."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.demo.cells import SHAPE
from cellwatt.emulation import ArmSignals
from cellwatt_plugins.energy.drive import features, supply_power
from cellwatt_plugins.energy.known import load_known
from cellwatt_plugins.robot import Arm


def test_the_demos_energy_file_predicts_the_power_of_the_emulated_arm() -> None:
    arm = Arm.load(SHAPE.with_name("robot.yaml"))
    known = load_known(SHAPE.with_name("energy.json"), arm)
    emulated = ArmSignals(noise=0.0)
    seen = emulated.at(np.arange(0, emulated.period, 0.02))

    def joints(quantity: str) -> np.ndarray:
        return np.column_stack([seen[f"joint_{i}.{quantity}"] for i in range(1, 7)])

    torque = joints("current") * arm.column("torque_constant")
    power = supply_power(known.drive, features(arm, torque, joints("velocity")) @ known.drive.weights())
    assert power == pytest.approx(seen["supply.power"], abs=1e-6)
    assert known.viscous == emulated.viscous
