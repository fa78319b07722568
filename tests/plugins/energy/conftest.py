import json
from dataclasses import replace

import pytest


@pytest.fixture(scope="session")
def measured(tmp_path_factory):
    """A small campaign of an arm whose torque is off, and the key to it."""
    from energy.arms import Case
    from energy.plant import write_campaign

    case = Case("small", 21, speeds=(150.0, 400.0, 1400.0), repetitions=3)
    folder = tmp_path_factory.mktemp("measured")
    return case, folder, write_campaign(case, folder)


@pytest.fixture(scope="session")
def outcome(measured):
    """What disaggregation makes of it."""
    from tests.plugins.energy.running import run_on

    return run_on(measured[1])


@pytest.fixture(scope="session")
def arm_and_known(measured, outcome):
    """The arm, and what the live stage reads of that: ``out/energy.json`` in the folder of the campaign."""
    from cellwatt_plugins.energy.known import load_known
    from cellwatt_plugins.robot import Arm

    path = measured[1] / "out" / "energy.json"
    path.parent.mkdir()
    path.write_text(json.dumps(outcome.findings.as_json()))
    arm = Arm.load(measured[1])
    return arm, load_known(path, arm)


@pytest.fixture(scope="session")
def variant(tmp_path_factory, measured):
    """Makes other campaigns of the same kind."""
    from energy.plant import write_campaign

    def make(**changed):
        folder = tmp_path_factory.mktemp("variant")
        return folder, write_campaign(replace(measured[0], **changed), folder)

    return make
