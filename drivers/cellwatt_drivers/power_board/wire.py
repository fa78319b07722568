"""Bytes of the serial port ⇄ packets of the board, in each of the receiver's modes; no I/O, no clock."""

from __future__ import annotations

from typing import Literal, get_args

from cellwatt_drivers.power_board import transparent, xbee
from cellwatt_drivers.power_board.payload import Packet, parse
from cellwatt_drivers.power_board.scanner import Decoder

Mode = Literal["api", "api_escaped", "transparent"]
MODES: tuple[Mode, ...] = get_args(Mode)

_SEEN = {
    "api": "XBee API frames without escaping (AP=1)",
    "api_escaped": "XBee API frames with escaping (AP=2)",
    "transparent": "frames of the transparent mode (AP=0)",
}


def decoder(mode: Mode) -> Decoder[Packet]:
    """A new decoder for the receiver's mode."""
    if mode == "transparent":
        return transparent.TransparentDecoder(parse)
    return xbee.ApiDecoder(parse, escaped=mode == "api_escaped")


def wrap(payload: bytes, mode: Mode, *, sender: int = 0, network: int = 0xFFFE, explicit: bool = False) -> bytes:
    """Return the receiver's bytes for a payload; ``explicit``: frame type 0x91 in place of 0x90."""
    if mode == "transparent":
        return transparent.frame(payload)
    data = (xbee.receive_explicit_data if explicit else xbee.receive_data)(payload, sender, network)
    return xbee.frame(data, escaped=mode == "api_escaped")


def diagnose(data: bytes, mode: Mode) -> str:
    """Describe ``data`` in which ``mode`` found no packet, and what to do."""
    for other in MODES:
        if other != mode and decoder(other).feed(data):
            return f"these are {_SEEN[other]}: set mode: {other}, or set the receiver to {_AP[mode]}"
    for other in MODES[:2]:
        trial = decoder(other)
        trial.feed(data)
        foreign = trial.counts["foreign payloads"]
        frames = sum(n for name, n in trial.counts.items() if name.startswith("frames: ") and "unknown" not in name)
        if foreign > 1:
            return f"these are {_SEEN[other]}, but what they carry is not a power board's payload"
        if frames > 1:
            return f"these are {_SEEN[other]}, but none carries data: is the board on and joined?"
    return "wrong baud rate or mode?"


_AP = {"api": "AP=1", "api_escaped": "AP=2", "transparent": "AP=0"}
