"""When a channel counts as outside its band."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.results import Interval
from cellwatt_plugins.explain.live.band import Band, IntervalResidual
from cellwatt_plugins.explain.live.explainer import Explainer
from cellwatt_plugins.explain.live.history import History
from cellwatt_plugins.explain.live.intake import Judged
from cellwatt_plugins.explain.live.motions import MOST, Motions
from cellwatt_plugins.explain.live.settings import BandSettings, ExplainSettings
from cellwatt_plugins.explain.live.watch import STALE, ChannelWatch

ELBOW = Judged("arm.joint_3.torque", "Nm", 3, "The torque of joint 3")
SUPPLY = Judged("meter.supply.power", "W", None, "The supply's power")


def interval(number, moving=(3,), way=0.5, pose=0.0, length=1.0):
    start = number * 10**9
    where, by = [0.0] * 6, [0.0] * 6
    where[2], by[2] = pose, way
    return Interval("arm", number, start, start + round(length * 1e9), moving, tuple(by), tuple(where), (0.0,) * 6)


def reading(outside, channel=ELBOW):
    return IntervalResidual(channel, 2.0 if outside else 0.5, 0.4, 10.0, 0.1, 1.0)


class Watching:
    def __init__(self, confirm=3):
        self.watch = ChannelWatch("mismatch", "arm", confirm)
        self.number = 0

    def see(self, motions, outside):
        """Readings, one interval each; gives what was raised (+) and cleared (-) at which interval."""
        out = []
        for motion in motions:
            self.number += 1
            alarms = self.watch.take(motion, interval(self.number), [reading(outside(motion))])
            out += [("+" if alarm.active else "-", self.number, alarm) for alarm in alarms]
        return out


def test_one_motion_of_a_cycle_that_is_outside_each_time():
    changes = Watching().see([0, 1, 2, 3] * 3, lambda motion: motion == 2)
    assert [(sign, n) for sign, n, _ in changes] == [("+", 11)]
    assert changes[0][2].since == 3 * 10**9
    assert changes[0][2].evidence["intervals"] == 3


def test_cleared_once_each_motion_was_inside_as_often():
    watching = Watching()
    watching.see([0, 1, 0, 1], lambda motion: True)
    assert watching.watch.outside == 4
    assert watching.see([0, 0, 0, 1, 1], lambda motion: False) == []
    cleared = watching.see([1], lambda motion: False)
    assert [(sign, n) for sign, n, _ in cleared] == [("-", 10)]
    assert cleared[0][2].since == 10**9
    assert watching.watch.outside == 0


def test_a_motion_that_is_not_done_any_more_is_forgotten():
    watching = Watching(confirm=1)
    assert len(watching.see([7], lambda motion: True)) == 1
    changes = watching.see([0] * STALE, lambda motion: False)
    assert [(sign, n) for sign, n, _ in changes] == [("-", STALE + 1)]


@pytest.mark.parametrize(
    "other",
    [interval(9, way=0.55), interval(9, pose=0.2), interval(9, moving=(2, 3)), interval(9, length=1.2)],
)
def test_what_is_another_motion(other):
    motions = Motions()
    assert motions.number(interval(1)) == 0
    assert motions.number(other) == 1


def test_motions_that_never_come_back_are_not_remembered_for_ever():
    motions = Motions()
    assert [motions.number(interval(1, pose=float(i))) for i in range(MOST + 1)] == list(range(MOST + 1))
    assert motions.number(interval(1, pose=float(MOST))) == MOST
    assert motions.number(interval(1, pose=0.0)) == MOST + 1, "the first is numbered anew"


def test_nothing_is_explained_of_what_was_not_compared():
    watching = Watching(confirm=1)
    watching.see([0], lambda motion: True)
    explainer = Explainer("mismatch", "weld-3", ExplainSettings(after=1), None, None, ())
    assert explainer.step(100 * 10**9, watching.watch, History(10, 1)) == []


def test_a_reading_is_measured_minus_simulated_against_noise_and_share():
    random = np.random.default_rng(2)
    band = Band(BandSettings(noise=4.0, share=0.1), [ELBOW, SUPPLY], 0.02)
    simulated = np.column_stack([np.full(400, 20.0), np.full(400, 300.0)])
    noise = random.standard_normal((400, 2)) * [0.5, 3.0]
    torque, power = band.read((3,), simulated + noise + [3.0, -12.0], simulated)
    assert torque.noise == pytest.approx(0.5, rel=0.2)
    assert torque.limit == pytest.approx(4 * torque.noise + 0.1 * 20.0)
    assert torque.residual == pytest.approx(np.hypot(3.0, 0.5), rel=0.03)
    assert torque.mean == pytest.approx(3.0, abs=0.1)
    assert power.residual == pytest.approx(12.0, abs=0.5), "the mean: noise and lag of a meter do not count"
    assert power.mean < 0
    assert not torque.outside
    assert not power.outside
