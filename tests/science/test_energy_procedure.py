"""ECDP from the recording to the report: four arms that draw what Tables II and III say."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.energy.campaign import disaggregate
from cellwatt_plugins.energy.fixed import AtRest, steady_power
from cellwatt_plugins.energy.procedure.cut import cut_programme, cut_state
from cellwatt_plugins.energy.procedure.recorded import motion_of, power_of
from cellwatt_plugins.energy.recordings import read_reading, read_runs
from cellwatt_plugins.robot import Arm
from tests.plugins.energy.procedure.cube import TABLE_SECONDS

REPETITIONS = 3


def measured(robot, folder, seed=1):
    """A campaign of an arm through the recording: the arm, and what disaggregation makes of the files cut from it."""
    from tests.plugins.energy.procedure import plant as plants
    from tests.plugins.energy.procedure.recording import Taped

    plant = plants.Arm(plants.ROBOTS[robot])
    arm = Arm.load(plant.describe(folder))
    taped = Taped(folder, plant, seed=seed)
    made, speeds = plant.made, tuple(plant.made.total)
    if made.separate:
        taped.state("controller", made.controller)
    taped.state("connected", made.controller + made.electronics)
    taped.state("released", made.fixed + 0.1)
    for payload in (0.0, plant.cube.payload):
        taped.programme(payload, *plant.programme(payload, speeds, REPETITIONS, taped.rng))
    recording = taped.write()
    for name, span in taped.states.items():
        cut_state(power_of(recording.between(*span)), folder / f"{name}.parquet")
    for payload, span in taped.programmes.items():
        part = recording.between(*span)
        recorded = motion_of(part, arm), power_of(part)
        runs = cut_programme(arm, *recorded, payload, speeds, REPETITIONS, REPETITIONS, folder)
        assert all(run.written and not run.refused for run in runs)
    return plant, disaggregated(arm, folder)


def disaggregated(arm, folder):
    states = {path.stem: steady_power(read_reading(path)) for path in folder.glob("*ed.parquet")}
    controller = folder / "controller.parquet"
    alone = steady_power(read_reading(controller)) if controller.exists() else states["connected"]
    rest = AtRest(alone, states["connected"], states["released"])
    return disaggregate(arm, rest, read_runs(folder / "runs", arm.description.names)).findings


@pytest.mark.parametrize("robot", ["UR5e", "UR10e", "FR3", "Gen3"])
def test_the_emulated_arms_draw_what_the_tables_say(robot):
    """Within 1 % of the run's energy in Table III, at the time that the cube takes."""
    from tests.plugins.energy.procedure import plant as plants

    plant = plants.Arm(plants.ROBOTS[robot])
    for speed, energies in plant.made.total.items():
        for payload, energy in zip((0.0, plant.cube.payload), energies, strict=True):
            true = plant.truth(speed, payload)
            pace = true["seconds"] * speed / 50 / TABLE_SECONDS[robot]
            assert true["total"] / pace == pytest.approx(energy, rel=0.01)
            assert pace == pytest.approx(1.0, abs=0.01)
    assert np.isfinite(plant.rates).all()
