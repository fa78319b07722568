"""The fault of the product's demo: a spring hooked on the elbow of the emulated arm."""

import numpy as np
import pytest

from cellwatt.emulation import ArmSignals
from tests.plugins.faults.paper.frames import frames_of
from tests.plugins.faults.paper.irb1200 import Told
from tests.plugins.faults.watching import learned, more, since_start, watch

ELBOW = 3
SPRING = {"spring": ELBOW, "stiffness": 60, "rest": 1.4}


def arm_frames(signals, seconds):
    """The arm's positions and its supply's power at 50 Hz."""
    t = np.arange(round(seconds * 50)) / 50
    told = signals.at(t)
    return frames_of(Told(t, np.column_stack([told[f"joint_{j}.position"] for j in range(1, 7)]), told["supply.power"]))


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return learned(tmp_path_factory.mktemp("arm") / "arm.yaml", arm_frames(ArmSignals(seed=99), 65.0))


@pytest.mark.parametrize("seed", [0, 1, *more(2, 3, 4, 5)])
def test_a_minute_of_healthy_running_gives_no_alarm(reference, seed):
    assert watch(reference, arm_frames(ArmSignals(seed=seed), 60.0)) == []


def moves_of_the_elbow(signals, until):
    """Start and end, s, of every move of the elbow."""
    cycles = range(int(until / signals.period) + 1)
    return [(c * signals.period + s, c * signals.period + s + 0.7) for c in cycles for s in signals.starts(ELBOW)]


# Wherever in the cycle (7.8 s) it is hooked on: at rest, in another joint's move, with the elbow bent or at home.
@pytest.mark.parametrize("at", [15.0, 19.2, *more(17.6, 21.9, 16.5, 18.7, 19.45, 20.3, 21.0, 22.6)])
def test_a_spring_on_the_elbow_is_named_while_the_elbow_first_moves(reference, at):
    signals = ArmSignals(seed=round(100 * at))
    signals.disturb({**SPRING, "at": at})
    alarms = watch(reference, arm_frames(signals, 32.0))
    first = next((a for a in alarms if a.active), None)
    assert first is not None
    start, end = next(move for move in moves_of_the_elbow(signals, 32.0) if move[0] >= at)
    assert start < since_start(first.time) <= end
    assert (first.kind, first.joint, first.alternatives, first.severity) == ("joint_fault", ELBOW, (), "error")
    assert {a.joint for a in alarms} == {ELBOW}
    assert "Joint 3 draws" in first.statement
    assert abs(first.evidence["power_residual_W"]) > first.evidence["power_limit_W"]
