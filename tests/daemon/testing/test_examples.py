"""The driver and the stage of examples/ install next to cellwatt and are citizens like ours."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from .installing import call, install

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL = """\
site: plant-1
cell: weld-3
sources:
  mains: {driver: mqtt_meter, host: 192.0.2.10, rate: 2 Hz}
stages:
  demand: {limit: 2.5 kW}
zenoh: off
"""

pytestmark = pytest.mark.timeout(240)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which both examples are installed."""
    pytest.importorskip("aiomqtt", reason="the example's library: pip install aiomqtt")
    folder = tmp_path_factory.mktemp("examples")
    for name in ("mqtt_meter", "demand_stage"):
        # From a copy: a build may leave files beside the source.
        install(Path(shutil.copytree(EXAMPLES / name, folder / name)), folder / "site")
    return folder / "site"


def test_both_are_listed(site):
    parts = {(p["kind"], p["name"]): p for p in json.loads(call(site, "-m", "cellwatt.commands", "drivers", "--json"))}
    assert parts["driver", "mqtt_meter"]["package"] == "cellwatt-mqtt-meter"
    assert parts["stage", "demand"]["package"] == "cellwatt-demand-stage"
    assert parts["driver", "mqtt_meter"]["loads"]
    assert parts["stage", "demand"]["loads"]


def test_a_cell_with_both_is_checked_like_any_other(site, tmp_path):
    cell = tmp_path / "cell.yaml"
    cell.write_text(CELL)
    told = call(site, "-m", "cellwatt.commands", "check", str(cell))
    assert "configuration is valid. Cell weld-3 at plant-1" in told
    assert "phase_1…3.voltage" in told


@pytest.mark.parametrize("name", [pytest.param("mqtt_meter", marks=pytest.mark.slow), "demand_stage"])
def test_their_own_tests_pass(site, name, tmp_path):
    options = ("-q", "-p", "no:cacheprovider", f"--basetemp={tmp_path / 'base'}")
    assert "passed" in call(site, "-m", "pytest", *options, cwd=site.parent / name)
