"""The files in ``examples/`` are right, with the drivers and stages that this distribution brings."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellwatt.config import load
from cellwatt.errors import ConfigError
from cellwatt.registry import available
from cellwatt.runtime.assemble import prepare

pytestmark = pytest.mark.usefixtures("real_parts")

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
ENVIRONMENT = {"PLANT_ROUTER": "router.example", "ZENOH_PASSWORD": "hunter2hunter2"}


@pytest.mark.parametrize(
    "name", ["ur-weld-cell", "yaskawa-line", "power-only", "plant-router", "fault-networks", "all-drivers"]
)
def test_example_is_right(name):
    prepared = prepare(load(EXAMPLES / f"{name}.yaml", ENVIRONMENT))
    assert prepared.layout.channels


def test_the_cell_of_all_drivers_has_each_driver():
    drivers = {source.driver for source in load(EXAMPLES / "all-drivers.yaml", {}).sources.values()}
    assert drivers | {"franka"} == set(available("cellwatt.drivers"))


def test_secrets_of_an_example_must_be_set():
    with pytest.raises(ConfigError, match="environment variable ZENOH_PASSWORD is not set"):
        load(EXAMPLES / "plant-router.yaml", {"PLANT_ROUTER": "router.example"})
