"""``cellwatt new-driver`` writes a package that works, and says why where it does not."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import pytest
from click.testing import CliRunner

from cellwatt.commands.new_package import driver as command
from cellwatt.commands.new_package import package

from .installing import call, install


def run(*arguments: object):
    return CliRunner().invoke(command, [str(a) for a in arguments], catch_exceptions=False)


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_the_package_installs_is_listed_and_passes_its_tests(tmp_path):
    result = run("torque_sensor", "--folder", tmp_path)
    assert result.exit_code == 0
    assert "cellwatt drivers torque_sensor" in result.output
    made = tmp_path / "torque_sensor"
    site = install(made, tmp_path / "site")
    assert "torque_sensor: a meter over TCP" in call(site, "-m", "cellwatt.commands", "drivers")
    options = ("-q", "-p", "no:cacheprovider", f"--basetemp={tmp_path / 'base'}")
    assert "passed" in call(site, "-m", "pytest", *options, cwd=made)


@pytest.mark.parametrize("tool", [["check", "--ignore", "I001"], ["format", "--check"]], ids=["lint", "format"])
def test_the_package_is_clean(tool, tmp_path):
    """But for the order of imports, which depends on what its author's ruff takes for first-party."""
    run("torque_sensor", "--folder", tmp_path)
    command = [sys.executable, "-m", "ruff", *tool, "--isolated", "--line-length", "120", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_names_are_put_everywhere():
    files = package("torque_sensor")
    assert not [path for path, text in files.items() if "skeleton" in text.lower() or "${" in text]
    project = tomllib.loads(files["pyproject.toml"])
    assert project["project"]["name"] == "cellwatt-torque-sensor"
    assert project["project"]["entry-points"]["cellwatt.drivers"] == {
        "torque_sensor": "torque_sensor:TorqueSensorDriver"
    }
    assert "class TorqueSensorDriver(" in files["torque_sensor/driver.py"]
    assert "tests/test_conformance.py" in files


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Torque-Sensor", "expected small letters"),
        ("class", "expected small letters"),
        ("ur", "there is a driver named 'ur' already"),
        ("json", "there is a Python package named 'json' already"),
    ],
)
def test_a_name_that_cannot_be(name, reason, tmp_path):
    result = run(name, "--folder", tmp_path)
    assert result.exit_code == 2
    assert reason in result.output
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "torque_sensor").mkdir()
    result = run("torque_sensor", "--folder", tmp_path)
    assert result.exit_code == 2
    assert "already exists" in result.output
    assert not list((tmp_path / "torque_sensor").iterdir())
