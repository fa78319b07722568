"""Pushes on several joints that are one push on the arm."""

from cellwatt_plugins.explain.verdict.events import merged
from cellwatt_plugins.explain.verdict.findings import Finding, Improvement, Span, Where
from cellwatt_plugins.robot.effects.effect import Parameter


def push(joint, unit, before):
    where = Where((f"tau_{joint}",), times=(Span("run_01", 2.0, 2.3),))
    error = Improvement(f"tau_{joint}", unit, before, 0.1, 0.1, False)
    return Finding(
        "external_contact", joint, "missing", 0.9, "Pushed.", {"torque": Parameter(7.0, 0.4, unit)}, where, error
    )


def test_one_push_is_told_at_the_joint_that_shows_it_best_with_each_joints_unit():
    (one,) = merged([push(1, "N*m", 2.0), push(2, "N*m", 3.0), push(3, "N", 1.0)])
    assert one.statement == "Pushed; joint 1 felt 7 ± 0.4 Nm of it; joint 3 felt 7 ± 0.4 N of it."
    assert one.where.channels == ("tau_2", "tau_1", "tau_3")
