"""Columns under unknown names are recognised by their content, and read under the names that the message asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt.tables import Table, usual
from cellwatt.tables.by_name import by_name
from cellwatt.tables.likely import likely
from cellwatt.tables.names import called, understood

TIME = np.arange(4000) * 0.005
PACE = np.array([1.1, 1.7])
Q = 0.8 * np.sin(PACE * TIME[:, None])
QD = 0.8 * PACE * np.cos(PACE * TIME[:, None])
TORQUE = 20 * np.cos(Q) + 3 * np.sign(QD) + 2 * QD + np.random.default_rng(1).normal(0, 0.2, Q.shape)


def table(position: str, velocity: str, torque: str) -> Table:
    noise = np.random.default_rng(2).normal(size=Q.shape)
    families = {position: Q, velocity: QD, torque: TORQUE, "Spare": noise}
    columns = {f"{name}{i}": values[:, i] for name, values in families.items() for i in range(2)}
    return Table(Path("log.csv"), {"time": TIME, **columns, "Lonely7": TIME, "Flag": TIME * 0})


def test_all_three_are_recognised_by_what_they_are_to_each_other() -> None:
    found = {each.quantity: each.pattern for each in likely(table("Angle", "Rate", "Moment"))}
    assert found == {"position": "Angle{}", "velocity": "Rate{}", "torque": "Moment{}"}


def test_what_is_known_already_is_not_offered() -> None:
    [torque] = likely(table("qpos", "qvel", "Moment"))
    assert str(torque) == ("Moment0 … Moment1 look like the torque of joints 1 to 2: pass --columns 'tau=Moment{}'")
    assert likely(table("qpos", "qvel", "tau_")) == []


def test_columns_that_name_their_joints_are_known() -> None:
    log = by_name(table("Pos_J", "Vel_J", "Trq_J"), ())
    [torque] = likely(log)
    assert str(torque).endswith("pass --columns 'tau=Trq_J{}'")


@pytest.mark.parametrize("rows", [0, 1])
def test_a_table_of_one_row_looks_like_nothing(rows: int) -> None:
    assert likely(table("Angle", "Rate", "Moment").at(np.arange(len(TIME)) < rows)) == []


def test_names_of_a_user_are_read_within_the_block() -> None:
    log = table("Angle", "Rate", "Moment")
    stems = [(usual(each.quantity), each.pattern) for each in likely(log)]
    with called(stems):
        read = Table(log.path, log.columns)
        np.testing.assert_array_equal(read.joints("torque"), TORQUE)
        np.testing.assert_array_equal(read.joints("position"), Q)
        assert understood("Moment1") is not None
    assert understood("Moment1") is None


@pytest.mark.parametrize(
    ("asked", "written", "known"),
    [("q [deg]", "A{}.pos", "q_2 [deg]"), ("t [ms]", "zeit", "t [ms]"), ("q_{}", "A{}.pos", "q_2")],
)
def test_a_users_name_may_have_a_unit(asked: str, written: str, known: str) -> None:
    with called([(asked, written)]):
        assert understood(written.format(2)) == understood(known) is not None


def test_a_users_name_that_no_column_has_is_listed() -> None:
    with called([("tau", "Moment{}"), ("q", "Winkel{}")]) as idle:
        assert idle() == [], "nothing was looked up"
        assert table("Angle", "Rate", "Moment").joints("torque") is not None
        assert idle() == ["Winkel{}"]


def test_files_may_have_different_names_for_one_quantity() -> None:
    with called([("q", "Angle{}"), ("q", "Winkel{}")]) as unused:
        for name in ("Angle", "Winkel"):
            np.testing.assert_array_equal(table(name, "Rate", "Moment").joints("position"), Q)
        assert unused() == []


def test_a_quantity_that_nobody_knows_is_refused() -> None:
    for name in ("moment", "{q}", "q [{}]"):
        with pytest.raises(ConfigError, match=r"is no name of a quantity"), called([(name, "Moment{}")]):
            pass
