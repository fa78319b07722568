"""The XBee module's answers to AT commands, as far as Digi's library asks when it opens a port."""

from __future__ import annotations

from collections import Counter

from cellwatt_drivers.power_board import xbee

_FIXED = {
    b"HV": b"\x42\x47",
    b"VR": b"\x10\x0a",
    b"SH": b"\x00\x13\xa2\x00",
    b"SL": b"\x40\x40\x11\x00",
    b"NI": b"CELLWATT",
    b"MY": b"\x00\x00",
    b"CE": b"\x01",
}
_OK, _BAD_COMMAND = b"\x00", b"\x02"
JOINED = bytes([xbee.MODEM_STATUS, 2])


class Modem:
    """A receiver in API mode, a coordinator; ``feed`` takes what a client wrote and gives the answers."""

    def __init__(self, *, escaped: bool) -> None:
        self._escaped = escaped
        self._values = {**_FIXED, b"AP": b"\x02" if escaped else b"\x01"}
        self._frames = (xbee.EscapedApiFrames if escaped else xbee.ApiFrames)(self._obey, Counter())
        self._answers = b""

    def feed(self, data: bytes) -> bytes:
        """Answer frames to the commands completed by these bytes; other frames are not answered."""
        self._answers = b""
        self._frames.feed(data)
        return self._answers

    def _obey(self, command: bytes) -> bool:
        if len(command) >= 4 and command[0] in {xbee.AT_COMMAND, xbee.AT_COMMAND_QUEUED}:
            name = command[2:4]
            value = self._values.get(name)
            status = _BAD_COMMAND if value is None else _OK
            answer = bytes([xbee.AT_RESPONSE, command[1]]) + name + status + (value or b"")
            self._answers += xbee.frame(answer, escaped=self._escaped)
        return True
