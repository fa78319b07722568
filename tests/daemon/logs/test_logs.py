"""Logs of other programs: the same motion from each, joints by name whatever their order."""

import errno
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

import cellwatt as cw
from cellwatt.commands import export, plot
from cellwatt.errors import RecordingError
from cellwatt.logs.opening import read_log
from cellwatt.tables import read_table
from tests.calling import called
from tests.daemon.logs.making import (
    COMMAND,
    EFFORT,
    JOINTS,
    POSITION,
    START,
    STEP,
    TIME,
    VELOCITY,
    bag,
    lerobot,
    mcap,
    mcap_ros2,
    states,
    store,
    usual,
)

SORTED = tuple(sorted(JOINTS))
STATE = "sensor_msgs/msg/JointState"


def written(path, form, joints=JOINTS):
    types = store("older" if form == "older" else "newer")
    topics = usual(types, joints, "older" if form == "older" else "newer")
    if form == "mcap_ros2":
        return mcap_ros2(path.with_suffix(".mcap"), topics, types)
    if form in ("mcap", "fastwrite"):
        return mcap(path.with_suffix(".mcap"), topics, types, use_chunking=form == "mcap")
    return bag(path, topics, types, storage=StoragePlugin.MCAP if form == "mcap folder" else StoragePlugin.SQLITE3)


@pytest.mark.parametrize("form", ["sqlite3", "older", "mcap folder", "mcap", "mcap_ros2", "fastwrite"])
def test_a_bag_gives_the_robots_joints_by_name(tmp_path, form):
    table = read_table(written(tmp_path / "bag", form, SORTED), JOINTS)
    np.testing.assert_allclose(table.time, TIME, atol=1e-9)
    for quantity, truth in (("position", POSITION), ("velocity", VELOCITY), ("torque", EFFORT), ("command", COMMAND)):
        assert np.array_equal(table.joints(quantity), truth), quantity
    assert table.named == JOINTS


def test_joints_in_another_order_give_the_same_table_and_export_byte_for_byte(tmp_path):
    one, other = (written(tmp_path / f"{i}" / "bag", "sqlite3", order) for i, order in enumerate((JOINTS, SORTED)))
    first, second = read_table(one), read_table(other)
    assert list(first.columns) == list(second.columns)
    assert all(np.array_equal(first.columns[name], second.columns[name]) for name in first.columns)
    assert first.joints("position") is None  # nothing says which joint is the first
    np.testing.assert_array_equal(first.columns["q_elbow_joint"], POSITION[:, 2])
    for path in (one, other):
        called(export.command, path, "--out", path.parent / "out")
    files = sorted(each.name for each in (one.parent / "out").iterdir())
    assert files == ["frames.parquet", "log.log.parquet"]
    assert all((one.parent / "out" / n).read_bytes() == (other.parent / "out" / n).read_bytes() for n in files)


@pytest.mark.parametrize("form", ["mcap", "mcap_ros2"])
def test_a_bag_opens_as_a_recording_with_its_own_time_and_is_drawn_and_exported(tmp_path, form):
    path = written(tmp_path / "bag", form)
    recording = cw.open(path)
    samples = recording.batches("log", "log")
    np.testing.assert_array_equal(samples.time, START + np.arange(len(TIME)) * STEP)
    frames = recording.frames_table()  # up to the last sample, and none without any
    assert len(frames) == len(TIME) and np.isfinite(frames.values).all()
    names = [channel.name for channel in recording.streams["log"][0].channels]
    np.testing.assert_array_equal(samples.values[:, names.index("elbow_joint.target_position")], COMMAND[:, 2])
    folder = recording.paths[0].parent
    del recording
    assert not folder.exists()
    drawn = [str(path), "--out", str(tmp_path / "plot.html"), "--channel"]
    called(plot.command, *drawn, "log.wrist_1_joint.position")
    assert "no such channels" in str(CliRunner().invoke(plot.command, [*drawn, "wrist_2_joint"]).exception)
    called(export.command, path, "--out", tmp_path / "out")
    exported = pq.read_table(tmp_path / "out" / "log.log.parquet")
    np.testing.assert_array_equal(exported["elbow_joint.position"], POSITION[:, 2])


def test_several_topics_are_listed_with_how_to_choose_one(tmp_path):
    types = store()
    topics = {f"/{side}/joint_states": (STATE, states(types, JOINTS[:k])) for side, k in (("left", 2), ("right", 4))}
    path = bag(tmp_path / "bag", topics, types)
    with pytest.raises(RecordingError, match=r"/left/joint_states, /right/joint_states; choose one as '.*#/left"):
        read_log(path)
    assert read_log(path.with_name("bag#") / "left" / "joint_states").joints == tuple(sorted(JOINTS[:2]))
    called(export.command, f"{path}#/right/joint_states", "--out", tmp_path / "out")
    with pytest.raises(RecordingError, match=r"no joints under /other; it has /left/joint_states"):
        read_log(tmp_path / "bag#" / "other")


def test_joints_of_two_publishers_and_commands_as_joint_states_go_together(tmp_path):
    types = get_typestore(Stores.ROS2_HUMBLE)
    merged = sorted([*states(types, JOINTS[:3]), *states(types, JOINTS[3:])], key=lambda each: each[0])
    topics = {"/joint_states": (STATE, merged), "/joint_command": (STATE, states(types, SORTED, effort=False))}
    table = read_table(bag(tmp_path / "bag", topics, types), JOINTS)
    assert np.array_equal(table.joints("position"), POSITION)
    assert np.array_equal(table.joints("command"), POSITION)


def test_a_bag_without_joints_says_what_it_has(tmp_path):
    types = get_typestore(Stores.ROS2_HUMBLE)
    message = types.types["std_msgs/msg/String"](data="hello")
    path = bag(tmp_path / "bag", {"/chatter": ("std_msgs/msg/String", [(START, message)])}, types)
    has = "not a recording of cellwatt: it has /chatter of std_msgs/msg/String; joints are read of sensor_msgs"
    with pytest.raises(RecordingError, match=has):
        read_log(path)


def test_a_joint_that_the_log_does_not_have_is_named_with_those_that_it_has(tmp_path):
    path = written(tmp_path / "bag", "sqlite3")
    missing = "joint wrist_3_joint of the robot is not in the log, which has elbow_joint"
    with pytest.raises(RecordingError, match=missing):
        read_table(path, (*JOINTS, "wrist_3_joint"))
    table = read_table(path, ("Shoulder_Pan", "ur/elbow_joint"))  # but for capitals, affix and namespace
    np.testing.assert_array_equal(table.joints("position"), POSITION[:, [0, 2]])


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_lerobot_data_set_in_degrees(tmp_path, version):
    path = lerobot(tmp_path / "set", version=version, episodes=3)
    with pytest.raises(RecordingError, match=r"3 episodes: 0, 1, 2; choose one as '.*set#0'"):
        read_table(path)
    table = read_table(tmp_path / "set#1", ("d", "a", "b", "c"))
    np.testing.assert_allclose(table.joints("position"), POSITION[:, [3, 0, 1, 2]], atol=1e-6)
    np.testing.assert_allclose(table.joints("command"), COMMAND[:, [3, 0, 1, 2]], atol=1e-6)
    np.testing.assert_allclose(table.time, TIME, atol=1e-6)
    with pytest.raises(RecordingError, match=r"no episode 7; there are: 0 … 2"):
        read_table(tmp_path / "set#7")
    with pytest.raises(RecordingError, match=r"expected the number of an episode, deg or rad behind #, not ²"):
        read_table(tmp_path / "set#²")
    if version == "v2.1":
        file = path / "data" / "chunk-000" / "episode_000002.parquet"
        np.testing.assert_allclose(read_table(file).columns["q_a"], POSITION[:, 0], atol=1e-6)


def test_positions_in_rad_stay_and_shares_of_a_range_are_refused(tmp_path):
    table = read_table(lerobot(tmp_path / "rad", unit=1.0, names=("j1", "j2", "j3", "j4")))
    np.testing.assert_allclose(table.joints("position"), POSITION, atol=1e-6)
    share = lerobot(tmp_path / "share", unit=100 / np.abs(POSITION).max())
    with pytest.raises(RecordingError, match=r"shares of each joint's range in %, no angles"):
        read_table(share)
    factor = 100 / np.abs(POSITION).max() * np.pi / 180
    found = read_table(tmp_path / "share#0,deg").columns["q_c"]
    np.testing.assert_allclose(found, POSITION[:, 2] * factor, atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"features": {"observation.image": {}}}, r"without observation\.state; it has observation\.image"),
        ({"features": {"observation.state": "x"}}, r"no info\.json of a LeRobot data set"),
        ({"fps": 0}, r"fps is 0"),
    ],
)
def test_a_data_set_without_states_or_with_nonsense_says_what_it_has(tmp_path, changed, told):
    about = lerobot(tmp_path / "set") / "meta" / "info.json"
    about.write_text(json.dumps(json.loads(about.read_text()) | changed))
    with pytest.raises(RecordingError, match=told):
        read_table(tmp_path / "set")


def test_an_episode_whose_timestamps_stand_still_is_refused(tmp_path):
    (file,) = lerobot(tmp_path / "set").rglob("*.parquet")
    table = pq.read_table(file)
    pq.write_table(table.set_column(2, "timestamp", pa.array(np.zeros(len(table)))), file)
    with pytest.raises(RecordingError, match="timestamps of the episode do not rise"):
        read_table(tmp_path / "set")


def test_a_bag_whose_metadata_are_torn_is_refused_in_one_line(tmp_path):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: [1\n")
    with pytest.raises(RecordingError) as caught:
        read_table(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path}: cannot be read as a ROS 2 bag: ")
    assert len(str(caught.value).splitlines()) == 1


def test_a_folder_that_cannot_be_listed_is_refused_in_one_line(tmp_path, monkeypatch):
    def fail(_):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(Path, "iterdir", fail)
    with pytest.raises(RecordingError, match=r": cannot be read: Input/output error$"):
        read_table(tmp_path)


@pytest.mark.parametrize("form", ["sqlite3", "mcap folder"])
def test_a_damaged_bag_is_refused_or_read_to_its_damage(tmp_path, form):
    path = written(tmp_path / "bag", form)
    file = next(each for each in path.iterdir() if each.suffix in (".db3", ".mcap"))
    content = file.read_bytes()
    for at in range(16, len(content), len(content) // 8):
        file.write_bytes(content[:at] + b"\xff\xff\xff\x7f" + content[at + 4 :])
        try:
            assert 0 < len(read_log(path).time) <= len(TIME)
        except RecordingError as error:
            assert str(error).startswith(str(path))
