"""Disaggregation of a folder that the plant wrote."""

from cellwatt_plugins.energy.campaign import disaggregate
from cellwatt_plugins.energy.fixed import AtRest, steady_power
from cellwatt_plugins.energy.recordings import read_reading, read_runs
from cellwatt_plugins.robot import Arm

STATES = ("controller", "connected", "released")
GROUPS = ("electronics", "brakes", "mechanical_losses", "electrical_losses_with_regeneration", "positive_mechanical")
MEASURED = (*GROUPS, "total")
"""What a campaign is to find of every run."""


def run_on(folder):
    arm = Arm.load(folder / "robot.yaml")
    rest = AtRest(*(steady_power(read_reading(folder / f"{state}.parquet")) for state in STATES))
    return disaggregate(arm, rest, read_runs(folder / "runs", arm.description.names))


def with_truth(key, findings):
    """Each run that was found, and its true energies."""
    found = {run.run: run for run in findings.runs}
    for true in key["runs"]:
        both = {"electrical_losses_with_regeneration": true["electrical_losses"] + true["regeneration"]}
        yield found[true["run"]], true | both


def worst_error(key, findings):
    """Per cent of the run's total, over all groups and runs."""
    return max(
        100 * abs(getattr(run, group) - true[group]) / true["total"]
        for run, true in with_truth(key, findings)
        for group in MEASURED
    )
