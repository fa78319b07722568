"""The messages of EGM as protobuf classes, built from a table.

Names and numbers are those of ABB's egm.proto (RobotWare 7.7; 3HAC073318 and the public abb_libegm). Every field is
optional here, even if ABB requires it, so that a message without it is parsed and not refused. Fields that the driver
does not read are left out.
"""

from __future__ import annotations

from typing import Any, Final

from cellwatt.protobuf import Messages, Table

_TABLE: Table = {
    "EgmHeader": {"seqno": (1, "uint32"), "tm": (2, "uint32"), "mtype": (3, "enum")},
    "EgmCartesian": {"x": (1, "double"), "y": (2, "double"), "z": (3, "double")},
    "EgmQuaternion": {"u0": (1, "double"), "u1": (2, "double"), "u2": (3, "double"), "u3": (4, "double")},
    "EgmClock": {"sec": (1, "uint64"), "usec": (2, "uint64")},
    "EgmPose": {"pos": (1, "EgmCartesian"), "orient": (2, "EgmQuaternion")},
    "EgmJoints": {"joints": (1, "double*")},
    "EgmMotion": {  # EgmFeedBack and EgmPlanned have the same fields
        "joints": (1, "EgmJoints"),
        "cartesian": (2, "EgmPose"),
        "externalJoints": (3, "EgmJoints"),
        "time": (4, "EgmClock"),
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


MESSAGES: Final = Messages("abb.egm", _TABLE)


def parse(datagram: bytes) -> Any:
    """Parse a robot's message. Raises ``ProtocolError`` if the bytes are not one."""
    return MESSAGES.parse("EgmRobot", datagram, "EGM")
