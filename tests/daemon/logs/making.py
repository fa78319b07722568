"""Logs by the reference writers: rosbags, mcap, and LeRobot's layout by pyarrow. Each says the same motion."""

import json
from dataclasses import fields, is_dataclass

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint")
N, STEP, START = 200, 10_000_000, 1_790_000_000_000_000_000
TIME = np.arange(N) * 1e-2
POSITION = np.sin(np.outer(TIME, [1.0, 1.5, 2.0, 2.5])) * [0.5, 0.9, 1.3, 2.0]
VELOCITY, EFFORT = np.cos(POSITION), POSITION * [30.0, 60.0, 20.0, 3.0]
COMMAND = POSITION + np.array([0.01, 0.02, 0.03, 0.04])
"""(N, 4) in the order of ``JOINTS``; each column is unlike the others."""
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
POINTS = {
    "newer": ("reference", "feedback", "error", "output"),
    "older": ("desired", "actual", "error"),
}


def store(version="newer"):
    types = get_typestore(Stores.ROS2_HUMBLE)
    parts = "".join(f"trajectory_msgs/JointTrajectoryPoint {name}\n" for name in POINTS[version])
    if version == "newer":
        multi = "".join(f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{n}\n" for n in POINTS[version])
        parts += "string[] multi_dof_joint_names\n" + multi
    text = f"std_msgs/Header header\nstring[] joint_names\n{parts}"
    types.register(get_types_from_msg(text, CONTROLLER))
    return types


def header(types, at):
    stamp = types.types["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
    return types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")


def states(types, joints=JOINTS, *, effort=True):
    """(time, message) of joint states in an order of joints."""
    order = [JOINTS.index(name) for name in joints]
    for i in range(N):
        at = START + i * STEP
        yield (
            at + 3_000_000,
            types.types["sensor_msgs/msg/JointState"](
                header=header(types, at),
                name=list(joints),
                position=POSITION[i, order],
                velocity=VELOCITY[i, order],
                effort=EFFORT[i, order] if effort else np.empty(0),
            ),
        )


def controls(types, joints=JOINTS, version="newer"):
    """(time, message) of a controller's state in an order of joints."""
    order = [JOINTS.index(name) for name in joints]
    point, nothing = types.types["trajectory_msgs/msg/JointTrajectoryPoint"], np.empty(0)
    duration = types.types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)

    def of(positions):
        return point(
            positions=positions, velocities=nothing, accelerations=nothing, effort=nothing, time_from_start=duration
        )

    multi = types.types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]
    for i in range(N):
        at = START + i * STEP
        said = dict(zip(POINTS[version], (of(COMMAND[i, order]), of(POSITION[i, order])), strict=False))
        said |= {name: of(nothing) for name in POINTS[version][2:]}
        if version == "newer":
            empty = multi(transforms=[], velocities=[], accelerations=[], time_from_start=duration)
            said |= {"multi_dof_joint_names": []} | {f"multi_dof_{name}": empty for name in POINTS[version]}
        yield at, types.types[CONTROLLER](header=header(types, at), joint_names=list(joints), **said)


def bag(path, topics, types, *, storage=StoragePlugin.SQLITE3):
    """A rosbag2 folder of ``{topic: (type, messages)}``."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        for topic, (kind, messages) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=types)
            for at, message in messages:
                writer.write(connection, at, types.serialize_cdr(message, kind))
    return path


def usual(types, joints=JOINTS, version="newer"):
    return {
        "/joint_states": ("sensor_msgs/msg/JointState", states(types, joints)),
        "/arm_controller/controller_state": (CONTROLLER, controls(types, joints, version)),
    }


def mcap(path, topics, types, **settings):
    """An MCAP file of the same by the writer of mcap."""
    with path.open("wb") as file:
        writer = McapWriter(file, **settings)
        writer.start(profile="ros2", library="another")
        for topic, (kind, messages) in topics.items():
            text, _ = types.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for at, message in messages:
                data = bytes(types.serialize_cdr(message, kind))
                writer.add_message(channel, log_time=at, publish_time=at, data=data)
        writer.finish()
    return path


def mcap_ros2(path, topics, types):
    """An MCAP file of the same by the writer of mcap-ros2-support, which has a CDR of its own."""
    writing = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed")
    with path.open("wb") as file:
        writer = writing.Writer(file)
        for topic, (kind, messages) in topics.items():
            schema = writer.register_msgdef(kind, types.generate_msgdef(kind, ros_version=2)[0])
            for at, message in messages:
                writer.write_message(topic, schema, plain(message), log_time=at, publish_time=at)
        writer.finish()
    return path


def plain(part):
    """A message as dictionaries and lists."""
    if is_dataclass(part):
        return {field.name: plain(getattr(part, field.name)) for field in fields(part)}
    if isinstance(part, list):
        return [plain(each) for each in part]
    return part.tolist() if isinstance(part, np.ndarray) else part


def lerobot(path, *, version="v2.1", episodes=1, unit=180 / np.pi, names=("a", "b", "c", "d")):
    """A LeRobot data set; in degrees by default, with a gripper from 0 to 100."""
    gripper = np.linspace(0, 100, N)
    tables = [
        pa.table(
            {
                "observation.state": list(np.column_stack([POSITION * unit, gripper]).astype(np.float32)),
                "action": list(np.column_stack([COMMAND * unit, gripper]).astype(np.float32)),
                "timestamp": pa.array(TIME, pa.float32()),
                "frame_index": np.arange(N),
                "episode_index": np.full(N, episode),
            }
        )
        for episode in range(episodes)
    ]
    (path / "meta").mkdir(parents=True)
    (path / "data" / "chunk-000").mkdir(parents=True)
    motors = [f"{name}.pos" for name in (*names, "gripper")]
    feature = {"dtype": "float32", "shape": [5], "names": {"motors": motors} if version == "v2.1" else motors}
    info = {"codebase_version": version, "fps": 100, "features": {"observation.state": feature, "action": feature}}
    (path / "meta" / "info.json").write_text(json.dumps(info))
    if version == "v2.1":
        for i, table in enumerate(tables):
            pq.write_table(table, path / "data" / "chunk-000" / f"episode_{i:06d}.parquet")
    else:
        pq.write_table(pa.concat_tables(tables), path / "data" / "chunk-000" / "file-000.parquet")
    return path
