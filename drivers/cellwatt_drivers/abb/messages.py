"""The messages of EGM as protobuf classes, made from a table.

Names and numbers are those of ABB's egm.proto (RobotWare 7.7; 3HAC073318 and the public abb_libegm). Every field is
optional here, also those that ABB requires, so that what a controller leaves out is seen and not refused. The classes
live in a pool of their own: another library's ``abb.egm`` in the same process does not clash with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from cellwatt.errors import ProtocolError

_PACKAGE = "abb.egm"
_SCALARS = {"double": 1, "uint64": 4, "bool": 8, "uint32": 13, "enum": 5}  # an enum travels as an int32 does
_MESSAGE = 11

# field: (number, type), a type with a star repeats.
_TABLE: Mapping[str, Mapping[str, tuple[int, str]]] = {
    "EgmHeader": {"seqno": (1, "uint32"), "tm": (2, "uint32"), "mtype": (3, "enum")},
    "EgmCartesian": {"x": (1, "double"), "y": (2, "double"), "z": (3, "double")},
    "EgmQuaternion": {"u0": (1, "double"), "u1": (2, "double"), "u2": (3, "double"), "u3": (4, "double")},
    "EgmEuler": {"x": (1, "double"), "y": (2, "double"), "z": (3, "double")},
    "EgmClock": {"sec": (1, "uint64"), "usec": (2, "uint64")},
    "EgmTimestamp": {"sec": (1, "uint64"), "nsec": (2, "uint64")},
    "EgmPose": {"pos": (1, "EgmCartesian"), "orient": (2, "EgmQuaternion"), "euler": (3, "EgmEuler")},
    "EgmJoints": {"joints": (1, "double*")},
    "EgmMotion": {  # EgmFeedBack and EgmPlanned are alike
        "joints": (1, "EgmJoints"),
        "cartesian": (2, "EgmPose"),
        "externalJoints": (3, "EgmJoints"),
        "time": (4, "EgmClock"),
        "timeStamp": (5, "EgmTimestamp"),
    },
    "EgmState": {"state": (1, "enum")},
    "EgmMeasuredForce": {"fcActive": (1, "bool"), "force": (2, "double*")},
    "EgmMeasuredForce6": {"force": (1, "double*")},  # RobotWare 6
    "EgmCollisionInfo": {"collsionTriggered": (1, "bool"), "collDetQuota": (2, "double*")},
    "EgmRobot": {
        "header": (1, "EgmHeader"),
        "feedBack": (2, "EgmMotion"),
        "planned": (3, "EgmMotion"),
        "motorState": (4, "EgmState"),
        "mciState": (5, "EgmState"),
        "mciConvergenceMet": (6, "bool"),
        "rapidExecState": (8, "EgmState"),
        "measuredForce": (9, "EgmMeasuredForce"),
        "utilizationRate": (10, "double"),
        "moveIndex": (11, "uint32"),
        "CollisionInfo": (12, "EgmCollisionInfo"),
        "torqueRef": (14, "EgmJoints"),
    },
}


@cache
def classes() -> Mapping[str, Any]:
    """Message classes by name; the library is loaded when they are first asked for."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    file = descriptor_pb2.FileDescriptorProto(name="cellwatt/egm.proto", package=_PACKAGE, syntax="proto2")
    for name, fields in _TABLE.items():
        message = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            plain = kind.removesuffix("*")
            added = message.field.add(name=field, number=number, label=3 if plain != kind else 1)
            added.type = _SCALARS.get(plain, _MESSAGE)
            if plain not in _SCALARS:
                added.type_name = f".{_PACKAGE}.{plain}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.{name}")) for name in _TABLE}


def parse(datagram: bytes) -> Any:
    """A robot's message. Raises ``ProtocolError`` where the bytes are none."""
    from google.protobuf.message import DecodeError

    message = classes()["EgmRobot"]()
    try:
        message.ParseFromString(datagram)
    except DecodeError as error:
        raise ProtocolError(f"{len(datagram)} bytes that are not EGM") from error
    return message
