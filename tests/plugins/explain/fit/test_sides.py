"""What samples count for."""

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.rows import Filtered
from cellwatt_plugins.explain.fit.sides import _until, rattling, supply_problem, torque_problem
from cellwatt_plugins.explain.input.admission import admit
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot import Arm
from tests.plugins.explain import plant
from tests.plugins.explain.input.reading import read_runs
from tests.plugins.explain.logs import measured, off_before, parquet, paused
from tests.plugins.robot import scara


def test_a_joint_that_rattles_counts_for_little_while_it_does():
    time = np.arange(2000) / 125
    slow, burst = np.sin(2 * np.pi * 0.5 * time), np.where((time > 8) & (time < 11), 1.0, 0.0)
    target = np.column_stack([slow, slow + 20 * burst * np.sin(2 * np.pi * 16 * time)])
    variance = rattling(target, Filtered(len(time), 5, 1 / 125, 8.0), np.ones(2))
    assert not variance[:, 0].any()
    assert not variance[(time < 7) | (time > 12), 1].any()
    assert np.all(np.sqrt(variance[(time > 8.5) & (time < 10.5), 1]) > 1.0)


@pytest.mark.parametrize(("rows", "there"), [(0, [5]), (3, [5, 6, 7, 8]), (-2, [3, 4, 5])])
def test_what_the_motion_leaves_unsure_is_so_until_it_was_read(rows, there):
    values = np.zeros((12, 1))
    values[5] = 1.0
    assert np.flatnonzero(_until(values, rows)[:, 0]).tolist() == there


def test_the_short_stroke_of_a_slide_is_compared(tmp_path):
    """40 mm are far for a press, 40 mrad are little for a turning joint."""
    time, *courses = scara.motion()
    q, qd, qdd = (course * (1.0, 1.0, 0.04 / np.ptp(courses[0][:, 2])) for course in courses)
    noise = np.random.default_rng(1).normal(0, (0.1, 0.05, 0.3), q.shape)
    run = Run("press", time, q, qd, scara.torque(q, qd, qdd) + noise)
    admitted = admit([run], Arm.load(scara.write(tmp_path)))
    assert list(admitted.notes) == ["no power recorded: effects that show only in the supply cannot be tested"]
    assert torque_problem([run], admitted.states).observed == [0, 1, 2]


@pytest.mark.parametrize("change", [paused, off_before])
def test_rows_that_do_not_count_are_no_quiet_noise(change, tmp_path, arm):
    columns = measured(plant.record("run", 1, plan=False))

    def floors(columns):
        runs = read_runs([parquet(tmp_path / "run.parquet", columns)], [], arm.description)
        states = admit(runs, arm).states
        supply = supply_problem(runs, states, [np.zeros_like(run.position) for run in runs])
        return np.append(torque_problem(runs, states).floor, supply.floor)

    assert floors(columns)[:3] == pytest.approx(plant.TORQUE_NOISE, rel=0.1)
    assert floors(change(columns, 30)) == pytest.approx(floors(columns), rel=0.1)
