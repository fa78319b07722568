import pytest

from cellwatt_plugins.faults.cycles.findings import judge_recording
from cellwatt_plugins.faults.cycles.known import learn_known
from cellwatt_plugins.faults.cycles.live import CycleWatch
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.robot import Arm
from tests.plugins.faults.cycles.four_joints import RATE, Cycle, describe, run

HEALTHY = [Cycle(task.upper(), 0.6 if task.islower() else 1.0) for task in "AbBAaBABaAbB"]
"""Lower case: slower."""


def recorded(measured):
    return Recording(measured.time, measured.position, measured.power)


def judged(known, measured):
    return judge_recording(recorded(measured), known)


def fed(known, measured, block=20):
    """What is told of a recording that comes block by block."""
    watch = CycleWatch(known, 1 / RATE)
    told = []
    for first in range(0, len(measured.time), block):
        part = slice(first, first + block)
        told += watch.feed(measured.time[part], measured.position[part], measured.power[part])
    return [*told, *watch.close()]


def names(findings):
    return [[(fault.joint, fault.kind) for fault in cycle.faults] for cycle in findings]


@pytest.fixture(scope="session")
def robot(tmp_path_factory):
    return Arm.load(describe(tmp_path_factory.mktemp("points")))


@pytest.fixture(scope="session")
def healthy():
    return recorded(run(HEALTHY, seed=1))


@pytest.fixture(scope="session")
def known(healthy, robot):
    return learn_known(healthy, robot)


@pytest.fixture(scope="session")
def of_two_joints(robot):
    """Knowledge of a cell with a task in which only joints 1 and 3 move."""
    return learn_known(recorded(run([Cycle(task) for task in "DBBDDBDBBD"], seed=3)), robot)


@pytest.fixture(scope="session")
def of_single_joints(robot):
    """Knowledge of a cell with a task whose first and last move are each of one joint."""
    return learn_known(recorded(run([Cycle("F")] * 10, seed=1)), robot)
