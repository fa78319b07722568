"""Files whose joints have names: columns go to the robot's joints by name, in whatever order the file has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt.tables import Table, read_table

ROBOT = ("shoulder_joint", "elbow_joint")
POSITION, EFFORT = [[1, 2], [3, 4]], [[5, 6], [7, 8]]
"""Two rows of shoulder and elbow."""


def read(folder: Path, text: str, joints: tuple[str, ...] = ROBOT) -> Table:
    path = folder / "a.csv"
    path.write_text(text)
    return read_table(path, joints)


@pytest.mark.parametrize(
    "text",
    [
        "__time,/joint_states/elbow_joint/effort,/joint_states/elbow_joint/position,"
        "/joint_states/shoulder_joint/effort,/joint_states/shoulder_joint/position\n0,6,2,5,1\n1,8,4,7,3\n",
        "t,elbow_joint_position,elbow_joint_effort,shoulder_joint_position,shoulder_joint_effort\n0,2,6,1,5\n1,4,8,3,7\n",
        "t,gripper.pos,elbow.pos,shoulder.pos,elbow.torque,shoulder.torque\n0,9,2,1,6,5\n1,9,4,3,8,7\n",
        "time,qpos_elbow,qpos_shoulder,qfrc_actuator_elbow,qfrc_actuator_shoulder\n0,2,1,6,5\n1,4,3,8,7\n",
        "%time,field.name0,field.name1,field.position0,field.position1,field.effort0,field.effort1\n"
        "0,elbow_joint,shoulder_joint,2,1,6,5\n1000000000,elbow_joint,shoulder_joint,4,3,8,7\n",
        "time,name,position,effort\n"
        "0,\"['elbow_joint', 'shoulder_joint']\",\"[2, 1]\",\"array('d', [6.0, 5.0])\"\n"
        "1,\"['elbow_joint', 'shoulder_joint']\",\"[4, 3]\",\"array('d', [8.0, 7.0])\"\n",
        "t,left_elbow_joint_pos,left_shoulder_joint_pos,left_elbow_joint_eff,left_shoulder_joint_eff\n0,2,1,6,5\n1,4,3,8,7\n",
        "t,joint_2_pos,joint_1_pos,joint_2_effort,joint_1_effort\n0,2,1,6,5\n1,4,3,8,7\n",  # not this robot's names
        "t,elbow_position [mrad],shoulder_position [mrad],elbow_effort_mNm,shoulder_effort_mNm\n"
        "0,2000,1000,6000,5000\n1,4000,3000,8000,7000\n",
    ],
)
def test_joints_by_name(tmp_path: Path, text: str) -> None:
    table = read(tmp_path, text)
    np.testing.assert_allclose(table.needed("position", 2), POSITION)
    np.testing.assert_allclose(table.needed("torque", 2), EFFORT)
    assert len(table.rising_time()) == 2


def test_a_column_of_many_names_names_no_joints(tmp_path: Path) -> None:
    rows = "".join(f"{i},part {i},{i},{i}\n" for i in range(1000))
    table = read(tmp_path, f"t,name1,q_1,q_2\n{rows}")
    assert (table.named, table.joint_names("position")) == ((), ("q_1", "q_2"))


def test_joint_states_are_preferred_to_other_topics(tmp_path: Path) -> None:
    topics = [f"/{topic}/{joint}/position" for topic in ("dyn", "joint_states") for joint in ("elbow", "shoulder")]
    table = read(tmp_path, f"t,{','.join(topics)}\n0,9,9,2,1\n")
    assert table.needed("position", 2).tolist() == [[1, 2]]


def test_lists_of_names_in_parquet(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    names = [["elbow_joint", "finger", "shoulder_joint"]] * 2
    lists = {"name": names, "position": [[2.0, 9, 1], [4.0, 9, 3]], "effort": [[6.0, 0, 5], [8.0, 0, 7]]}
    pq.write_table(pa.table({"header.stamp.sec": [7, 7], "header.stamp.nanosec": [0, 20_000_000], **lists}), path)
    table = read_table(path, ROBOT)
    np.testing.assert_array_equal(table.joints("position"), POSITION)
    np.testing.assert_array_equal(table.joints("torque"), EFFORT)
    np.testing.assert_allclose(table.time, [7, 7.02], rtol=0, atol=1e-9)


def test_without_a_robot_only_numbers_give_an_order(tmp_path: Path) -> None:
    counted = read(tmp_path, "t,joint_2_pos,joint_1_pos\n0,2,1\n1,4,3\n", ())
    assert counted.needed("position", 2).tolist() == POSITION
    assert counted.named == ("joint_1", "joint_2")
    named = read(tmp_path, "t,shoulder_pos,elbow_pos\n0,1,2\n1,3,4\n", ())
    assert named.joints("position") is None
    assert named.named == ("shoulder", "elbow"), "as the columns are"


def test_what_is_no_position_of_a_joint_stays_unknown(tmp_path: Path) -> None:
    text = "t,position_error_1,position_error_2,target_elbow_pos,tcp_position\n0,1,2,3,4\n1,1,2,3,4\n"
    assert read(tmp_path, text).joints("position") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,elbow_pos,wrist_pos\n0,1,2\n1,1,2\n", "joint shoulder_joint of the robot is not in the log"),
        ("t,a_elbow_pos,b_elbow_pos,shoulder_pos\n0,1,2,3\n1,1,2,3\n", "elbow_joint of the robot stands for several"),
        ("t,/a/elbow/pos,/a/shoulder/pos,/b/elbow/pos,/b/shoulder/pos\n0,1,2,3,4\n", "under /a, /b"),
        ("t,name_0,name_1,q_0,q_1\n0,a,elbow,1,2\n1,elbow,a,2,1\n", "the joint of column q_0 changes"),
        (
            "t,elbow_pos,shoulder_pos,tau_1,tau_2\n0,2,1,6,5\n",
            "column tau_1 numbers its joint, while the positions of elb",
        ),
    ],
)
def test_joints_that_are_not_certain_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        read(tmp_path, text)


@pytest.mark.parametrize("name", ["P (W)", "Active Power [W]", "Pges [W]", "Leistung [Watt]", "apower"])
def test_the_only_column_in_watt_of_a_meter_is_its_power(tmp_path: Path, name: str) -> None:
    power = read(tmp_path, f"t,{name},U (V)\n0,80,230\n1,90,230\n", ()).whole("supply.power")
    assert power is not None
    assert power.tolist() == [80, 90]


@pytest.mark.parametrize(
    "others", ["P1 (W),P2", "P1 (W),P2 (W),P3", "q_1,Heat", "qd_1,Heat", "U (V),Apparent power", "U (V),Laser setpoint"]
)
@pytest.mark.parametrize("cell", ["1", "ERR"])
def test_a_column_in_watt_that_may_be_another_power_is_not_taken(tmp_path: Path, others: str, cell: str) -> None:
    row = ",".join("80" for _ in others.split(",")[1:])
    assert read(tmp_path, f"t,{others} (W)\n0,{row},{cell}\n1,{row},1\n", ()).whole("supply.power") is None
