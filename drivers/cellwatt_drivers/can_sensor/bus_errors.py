"""Error frames of Linux SocketCAN (linux/can/error.h), decoded by pure functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

BusState = Literal["active", "warning", "passive", "off"]

TX_TIMEOUT, LOST_ARBITRATION, CONTROLLER, PROTOCOL, TRANSCEIVER, NO_ACK, BUS_OFF, BUS_ERROR, RESTARTED = (
    1 << bit for bit in range(9)
)
_NAMES = {
    TX_TIMEOUT: "transmit timeout",
    LOST_ARBITRATION: "lost arbitration",
    CONTROLLER: "controller",
    PROTOCOL: "protocol",
    TRANSCEIVER: "transceiver",
    NO_ACK: "no acknowledgement",
    BUS_OFF: "bus off",
    BUS_ERROR: "bus error",
    RESTARTED: "restarted",
}
_OVERFLOW = 0x03
_WARNING = 0x0C
_PASSIVE = 0x30
_ACTIVE = 0x40


@dataclass(frozen=True, slots=True)
class BusError:
    """The classes of one error frame, the controller's state if the frame reports it, and overflow."""

    names: tuple[str, ...]
    state: BusState | None
    overflow: bool


def decode_error(identifier: int, data: bytes) -> BusError:
    """Decode an error frame: its classes are bits of the identifier, details of the controller are in byte 1."""
    names = tuple(name for bit, name in _NAMES.items() if identifier & bit)
    controller = data[1] if identifier & CONTROLLER and len(data) > 1 else 0
    state: BusState | None = None
    if identifier & BUS_OFF:
        state = "off"
    elif controller & _PASSIVE:
        state = "passive"
    elif controller & _WARNING:
        state = "warning"
    elif identifier & RESTARTED or controller & _ACTIVE:
        state = "active"
    return BusError(names or ("unknown",), state, bool(controller & _OVERFLOW))
