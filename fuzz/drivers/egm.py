"""EGM datagrams of a robot, up to samples."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import get_args

from cellwatt.channel import Stream
from cellwatt.errors import ProtocolError
from cellwatt_drivers.abb import wire
from cellwatt_drivers.abb.intake import Intake
from cellwatt_drivers.abb.messages import MESSAGES
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target

COLUMNS = wire.columns(get_args(wire.Group), 6, ("rotary", "linear"))


def run(data: bytes) -> None:
    """Datagrams of a length in their first two bytes, one behind the other."""
    datagrams = []
    while len(data) >= 2:
        size = int.from_bytes(data[:2], "big")
        datagrams.append(data[2 : 2 + size])
        data = data[2 + size :]
    inlet = CheckingInlet()
    intake = Intake(inlet, Stream("egm", COLUMNS.channels, 250.0, "device"), COLUMNS, lambda: None)
    intake.take(datagrams)
    for datagram in datagrams:
        intake.opened()
        intake.take([datagram])
        with suppress(ProtocolError):
            first = wire.decode(datagram)
            again = wire.decode(first.message.SerializeToString())
            assert (first.sequence, first.sent, first.clock) == (again.sequence, again.sent, again.clock)
            assert str(COLUMNS.row(first.message)) == str(COLUMNS.row(again.message))


def datagram(sequence: int, clock: int | None, older_force: bool = False) -> bytes:
    """A full message; ``clock`` in µs."""
    message = MESSAGES.classes["EgmRobot"]()
    message.header.seqno, message.header.tm, message.header.mtype = sequence, 4 * sequence, wire.DATA
    message.feedBack.joints.joints.extend([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    message.feedBack.externalJoints.joints.append(7.0)
    message.feedBack.cartesian.pos.x = 500.0
    message.feedBack.cartesian.orient.u0 = 1.0
    if clock is not None:
        message.feedBack.time.sec, message.feedBack.time.usec = divmod(clock, 1_000_000)
    message.planned.joints.joints.extend([1.0] * 6)
    message.motorState.state = message.rapidExecState.state = message.mciState.state = 1
    message.moveIndex = 3
    message.CollisionInfo.collsionTriggered = True
    message.torqueRef.joints.extend([0.5] * 6)
    if older_force:
        older = MESSAGES.classes["EgmMeasuredForce6"]()
        older.force.extend([1.0] * 6)
        message.measuredForce.ParseFromString(older.SerializeToString())
    else:
        message.measuredForce.fcActive = True
        message.measuredForce.force.extend([1.0] * 6)
    return bytes(message.SerializeToString())


def seeds() -> Iterable[bytes]:
    """Some datagrams in a row, with and without a clock, of RobotWare 6 and 7."""
    rows = [
        [datagram(i, 1_700_000_000_000_000 + 4000 * i) for i in (1, 2, 2, 5)],
        [datagram(i, None, True) for i in (1, 2, 3)],
        [b"", b"\x08\x01"],
    ]
    for row in rows:
        yield b"".join(len(d).to_bytes(2, "big") + d for d in row)


TARGET = Target(run, seeds, 2048)
