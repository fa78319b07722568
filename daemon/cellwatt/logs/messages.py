"""Messages of bags: those of MCAP files by their own definitions, those of rosbag2 folders by ``rosbags``."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from mcap.records import Channel, McapRecord, Schema
from mcap.records import Header as McapHeader
from mcap.records import Message as McapMessage

from cellwatt.errors import ConfigError, RecordingError, why
from cellwatt.files import open_file
from cellwatt.logs.log import natural
from cellwatt.record.foreign import described, records

STATE: Final = "sensor_msgs/msg/JointState"
CONTROLLER: Final = "control_msgs/msg/JointTrajectoryControllerState"
_POINTS: Final = "std_msgs/Header header\nstring[] joint_names\n" + "".join(
    f"trajectory_msgs/JointTrajectoryPoint {{{i}}}\n" for i in range(3)
)
_OLDER: Final = _POINTS.format("desired", "actual", "error")
_NEWER: Final = (
    _POINTS.format("reference", "feedback", "error")
    + "trajectory_msgs/JointTrajectoryPoint output\nstring[] multi_dof_joint_names\n"
    + "".join(
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}\n"
        for name in ("reference", "feedback", "error", "output")
    )
)

Decode = Callable[[bytes], Any]


@dataclass(frozen=True)
class Message:
    """One message, logged at ``time``, UTC ns."""

    topic: str
    type: str
    time: int
    content: Any


@dataclass
class Bag:
    """Messages of the two types in a bag; ``topics``, ``unread`` and ``cut`` are set once they have been read."""

    path: Path
    topics: dict[str, str] = field(default_factory=dict)
    """Description of each topic, for error messages."""
    unread: dict[str, int] = field(default_factory=dict)
    """Number of messages that could not be decoded, by topic."""
    cut: str = ""
    """Reason why the file could not be read up to its end."""

    def messages(self) -> Iterator[Message]:
        """The messages in the order of the file. Raises ``RecordingError``, and ``ConfigError`` without ``rosbags``."""
        try:
            for file in self._files():
                yield from self._mcap(file) if file.suffix == ".mcap" else self._rosbag(file)
        except ImportError as error:
            raise ConfigError(f"{self.path}: reading ROS messages needs pip install 'cellwatt[logs]'") from error
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read: {why(error)}") from error

    def _files(self) -> list[Path]:
        """The files to read, in order; a folder without MCAP files but with metadata is read as a whole."""
        if not self.path.is_dir():
            return [self.path]
        files = sorted(self.path.iterdir(), key=lambda path: natural(path.name))
        whole = [self.path] if (self.path / "metadata.yaml").exists() else []
        return [p for p in files if p.suffix == ".mcap"] or whole or [p for p in files if p.suffix == ".db3"]

    def _mcap(self, path: Path) -> Iterator[Message]:
        with open_file(path) as file:
            try:
                yield from self._of_records(records(file))
            except ValueError as error:
                self.cut = str(error)

    def _of_records(self, found: Iterable[McapRecord]) -> Iterator[Message]:
        schemas: dict[int, Schema] = {}
        profile = ""
        known: dict[int, tuple[str, str, Decode]] = {}
        for record in found:
            if isinstance(record, McapHeader):
                profile = record.profile
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                schema = schemas.get(record.schema_id)
                kind = _full(schema.name) if schema else ""
                self.topics[record.topic] = described(profile, record, schema)
                if (decode := _decoder(record.message_encoding, schema, kind)) is not None:
                    known[record.id] = (record.topic, kind, decode)
            elif isinstance(record, McapMessage) and record.channel_id in known:
                topic, kind, decode = known[record.channel_id]
                yield from self._decoded(topic, kind, record.log_time, record.data, decode)

    def _rosbag(self, path: Path) -> Iterator[Message]:
        from rosbags.rosbag2 import Reader

        try:
            with Reader(path) as reader:
                self.topics.update({each.topic: f"{each.topic} of {each.msgtype}" for each in reader.connections})
                wanted = [each for each in reader.connections if each.msgtype in (STATE, CONTROLLER)]
                decoders = {}
                for each in wanted:
                    text = each.msgdef.data if each.msgdef.format.name == "MSG" else ""
                    decoders[each.topic] = _cdr(each.msgtype, text)
                for each, time, data in reader.messages(wanted) if wanted else ():
                    yield from self._decoded(each.topic, each.msgtype, time, data, decoders[each.topic])
        except (ImportError, OSError):
            raise
        except Exception as error:  # a damaged file makes SQLite and rosbags fail in any way
            text = " ".join(str(error).split()) or type(error).__name__
            raise RecordingError(f"{path}: cannot be read as a ROS 2 bag: {text}") from error

    def _decoded(self, topic: str, kind: str, time: int, data: bytes, decode: Decode) -> Iterator[Message]:
        try:
            content = decode(data)
        except ImportError:
            raise
        except Exception:  # data that contradict their definition make the decoder fail in any way
            self.unread[topic] = self.unread.get(topic, 0) + 1
            return
        yield Message(topic, kind, time, content)


def _full(name: str) -> str:
    """``sensor_msgs/msg/JointState`` for ``sensor_msgs/JointState`` and ``sensor_msgs::msg::JointState``."""
    parts = name.replace("::", "/").replace("dds_/", "").split("/")
    return f"{parts[0]}/msg/{parts[-1].removesuffix('_')}" if len(parts) > 1 else name


def _decoder(encoding: str, schema: Schema | None, kind: str) -> Decode | None:
    """Decoder of a channel; None if it is not of the two types, or its encoding is unknown."""
    if schema is None or kind not in (STATE, CONTROLLER):
        return None
    if encoding == "json":
        return partial(json.loads, object_hook=lambda fields: SimpleNamespace(**fields))
    text = schema.data.decode("utf-8", "replace")
    if encoding == "cdr":
        return _cdr(kind, text if schema.encoding == "ros2msg" else "")
    return (lambda data: _store(kind, text).deserialize_ros1(data, kind)) if encoding == "ros1" else None


def _cdr(kind: str, text: str) -> Decode:
    """Decoder by the file's own definition; without one, by those of ROS and of ros2_control, newest first."""
    definitions = [text] if text else [""] if kind == STATE else [_NEWER, _OLDER]

    def decode(data: bytes) -> Any:
        for definition in definitions[:-1]:
            with suppress(Exception):  # the last definition raises the error
                return _store(kind, definition).deserialize_cdr(data, kind)
        return _store(kind, definitions[-1]).deserialize_cdr(data, kind)

    return decode


_STORES: Final[dict[tuple[str, str], Any]] = {}


def _store(kind: str, definition: str) -> Any:
    """The types of ROS; with a ``definition`` also ``kind`` and the types that it names."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if (kind, definition) not in _STORES:
        store = get_typestore(Stores.ROS2_HUMBLE)
        if definition:
            types: Mapping[str, Any] = get_types_from_msg(definition, kind)
            # A file's copies of ROS's types may differ in comments and constants: only new types are added.
            store.register({name: each for name, each in types.items() if name == kind or name not in store.fielddefs})
        _STORES[kind, definition] = store
    return _STORES[kind, definition]
