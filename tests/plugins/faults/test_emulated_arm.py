"""The fault of the product's demo: a spring hooked on the elbow of the emulated arm."""

import pytest

from cellwatt.emulation import ArmSignals
from tests.plugins.faults.watching import arm_frames, learned, more, watch
from tests.plugins.segment.motions import since_start

ELBOW = 3
SPRING = {"spring": ELBOW, "stiffness": 60, "rest": 1.4}


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return learned(tmp_path_factory.mktemp("arm") / "arm.yaml", arm_frames(ArmSignals(seed=99), 65.0))


# Wherever in the cycle (7.8 s) it is hooked on: at rest, in another joint's move, with the elbow bent or at home.
@pytest.mark.parametrize("at", [15.0, 19.2, *more(17.6, 21.9, 16.5, 18.7, 19.45, 20.3, 21.0, 22.6)])
def test_a_spring_on_the_elbow_is_named_after_the_elbow_first_moves(reference, at):
    signals = ArmSignals(seed=round(100 * at))
    signals.disturb({**SPRING, "at": at})
    alarms = watch(reference, arm_frames(signals, 32.0))
    first = next((a for a in alarms if a.active), None)
    assert first is not None
    begins = [cycle * signals.period + start for cycle in range(5) for start in signals.starts(ELBOW)]
    start = next(begin for begin in begins if begin >= at)
    assert start < since_start(first.time) <= start + 0.7 + 0.4  # the elbow moves for 0.7 s, then rests
    assert (first.kind, first.joint, first.alternatives, first.severity) == ("joint_fault", ELBOW, (), "error")
    assert {a.joint for a in alarms} == {ELBOW}
    assert "Joint 3 works against a force" in first.statement
