"""EGM datagrams ⇄ values in SI units; pure functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from cellwatt.channel import Channel
from cellwatt.errors import ProtocolError
from cellwatt_drivers.abb.messages import MESSAGES, parse

PORT = 6510
CYCLE = 0.004
"""Controller cycle, s; it sends every cycle, or every n-th."""
DATA = 2
"""``mtype`` of a robot's messages."""
LARGEST = 4096
"""Largest datagram accepted as EGM, bytes; a full one has some 600."""

Group = Literal["joints", "planned", "tool", "state", "force", "torque", "collision"]
External = Literal["rotary", "linear"]

_RAD = math.radians(1.0)
_NAN = float("nan")
_FACTOR = {"rotary": _RAD, "linear": 1e-3}
_POSITION = {"rotary": "rad", "linear": "m"}
_EFFORT = {"rotary": "Nm", "linear": "N"}
_ON_OFF = {1: 1.0, 2: 0.0}
_RUNNING = {1: 0.0, 2: 1.0}
_LAST_SECOND = 9_000_000_000


@dataclass(frozen=True, slots=True)
class Packet:
    """One datagram: ``sequence`` and ``sent`` (ms, wraps at 2³²) of its header, ``clock`` the controller's time (ns
    since 1970) of the measured position, ``None`` if absent, and the ``message`` itself.
    """

    sequence: int
    sent: int
    clock: int | None
    message: Any


def decode(datagram: bytes) -> Packet:
    """Decode a datagram. Raises ``ProtocolError`` if it is not a robot's message."""
    message = parse(datagram)
    header = message.header
    if not header.HasField("seqno") or header.mtype != DATA:
        raise ProtocolError("not an EGM message of a robot: no sequence number, or not of the type DATA")
    clock = None
    if message.feedBack.HasField("time"):
        time = message.feedBack.time
        if time.sec > _LAST_SECOND or time.usec >= 1_000_000:
            raise ProtocolError(f"the controller's time {time.sec} s {time.usec} µs is invalid")
        clock = (time.sec * 1_000_000 + time.usec) * 1000
    return Packet(header.seqno, header.tm, clock, message)


_Kinds = tuple[External, ...]
_Read = Callable[[Any, _Kinds, _Kinds], Sequence[float]]
"""Reads the values of a group from a message, for robot joints and external axes of these kinds."""


@dataclass(frozen=True, slots=True)
class Columns:
    """The channels of some groups, and the functions that read them from a message; NaN for absent values."""

    channels: tuple[Channel, ...]
    arm: _Kinds
    external: _Kinds
    readers: tuple[tuple[_Read, int], ...]
    """Functions, each with the number of its values to use."""

    def row(self, message: Any) -> list[float]:
        """Values in the order of ``channels``."""
        found: list[float] = []
        for read, count in self.readers:
            found.extend(read(message, self.arm, self.external)[:count])
        return found


def columns(
    groups: Sequence[Group],
    axes: int,
    external: Sequence[External],
    robotware: int = 7,
    linear: Sequence[int] = (),
) -> Columns:
    """Columns for a robot with ``axes`` joints and ``external`` axes; RobotWare 6 has no ``move_index``.

    ``linear``: the numbers of linear joints.
    """
    arm: _Kinds = tuple("linear" if i in linear else "rotary" for i in range(1, axes + 1))
    states = _STATES if robotware > 6 else _STATES[:-1]
    made: Mapping[str, tuple[Sequence[Channel], _Read]] = {
        "joints": (_axes("position", arm, external), lambda message, *kinds: _angles(message.feedBack, *kinds)),
        "planned": (_axes("target_position", arm, external), lambda message, *kinds: _angles(message.planned, *kinds)),
        "tool": (_TOOL, _tool),
        "state": ([Channel(f"robot.{name}", "1", "discrete") for name in states], _state),
        "force": (_FORCE, lambda message, *_: _fit(force(message), [1.0] * 6)),
        "torque": (
            [Channel(f"joint_{i}.target_torque", _EFFORT[kind]) for i, kind in enumerate(arm, 1)],
            lambda message, arm, _: _fit(message.torqueRef.joints, [1.0] * len(arm)),
        ),
        "collision": ([Channel("robot.collision", "1", "discrete")], _collision),
    }
    chosen = [made[group] for group in groups]
    channels = tuple(channel for group, _ in chosen for channel in group)
    return Columns(channels, arm, tuple(external), tuple((read, len(group)) for group, read in chosen))


_STATES = ("motors_on", "program_running", "egm_state", "move_index")
# A quaternion and its negative are the same orientation: interpolation between the two is wrong.
_TOOL = (
    *(Channel(f"tool.{axis}", "m") for axis in "xyz"),
    *(Channel(f"tool.q{axis}", "1", align="hold") for axis in "wxyz"),
)
_FORCE = tuple(
    Channel(f"tool.{what}_{axis}", unit) for what, unit in (("force", "N"), ("torque", "Nm")) for axis in "xyz"
)


def _axes(quantity: str, arm: _Kinds, external: Sequence[External]) -> list[Channel]:
    channels = [Channel(f"joint_{i}.{quantity}", _POSITION[kind]) for i, kind in enumerate(arm, 1)]
    return channels + [Channel(f"external_{i}.{quantity}", _POSITION[kind]) for i, kind in enumerate(external, 1)]


def _fit(values: Sequence[float], factors: Sequence[float]) -> list[float]:
    """Values × factors; missing values are NaN, surplus ones are ignored."""
    found = [value * factor for value, factor in zip(values, factors, strict=False)]
    return found + [_NAN] * (len(factors) - len(found))


def _angles(motion: Any, arm: _Kinds, external: _Kinds) -> list[float]:
    # The position of a linear joint, in m, is sent like an angle in rad: converted to degrees.
    found = _fit(motion.joints.joints, [_RAD] * len(arm))
    return found + _fit(motion.externalJoints.joints, [_FACTOR[kind] for kind in external]) if external else found


def _tool(message: Any, arm: _Kinds, external: _Kinds) -> list[float]:
    pose = message.feedBack.cartesian
    at, turn = pose.pos, pose.orient
    place = [at.x * 1e-3, at.y * 1e-3, at.z * 1e-3] if pose.HasField("pos") else [_NAN] * 3
    return place + ([turn.u0, turn.u1, turn.u2, turn.u3] if pose.HasField("orient") else [_NAN] * 4)


def _state(message: Any, arm: _Kinds, external: _Kinds) -> list[float]:
    return [
        _ON_OFF.get(message.motorState.state, _NAN),
        _RUNNING.get(message.rapidExecState.state, _NAN),
        float(message.mciState.state) if message.HasField("mciState") else _NAN,
        float(message.moveIndex) if message.HasField("moveIndex") else _NAN,
    ]


def _collision(message: Any, arm: _Kinds, external: _Kinds) -> list[float]:
    return [float(message.CollisionInfo.collsionTriggered) if message.HasField("CollisionInfo") else _NAN]


def force(message: Any) -> Sequence[float]:
    """The measured force, N and Nm.

    RobotWare 6 sends it as field 1, which is a bool in RobotWare 7: its values are then among the unknown fields.
    """
    if not message.HasField("measuredForce"):
        return ()
    measured = message.measuredForce
    if measured.force or measured.HasField("fcActive"):
        return list(measured.force)
    from google.protobuf.message import DecodeError

    older = MESSAGES.classes["EgmMeasuredForce6"]()
    try:
        older.ParseFromString(measured.SerializeToString())
    except DecodeError:  # unknown fields hold any bytes: here, an incomplete number
        return ()
    return list(older.force)
