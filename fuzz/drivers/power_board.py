"""Serial bytes of the power board's receiver."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterable
from typing import get_args

import numpy as np

from cellwatt_drivers.power_board import payload, wire
from cellwatt_drivers.power_board.board import Board, board_stream
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target

PACKET = payload.Packet(1, 65535, 4_294_967_000, 8130, 1, (23000, 1500, 34500, 23001, 1501, -34501))


def run(data: bytes) -> None:
    """The first byte says in which mode and in what pieces the rest comes; then the rest as a payload."""
    if not data:
        return
    mode = wire.MODES[data[0] % len(wire.MODES)]
    whole = data[1:]
    _board(_fed(mode, whole, len(whole) or 1), _fed(mode, whole, 1 + data[0] // 3))
    assert "\n" not in wire.diagnose(whole, mode)
    body = whole + crc_hqx(whole, 0xFFFF).to_bytes(2, "little")
    packet = payload.parse(body)
    if packet is not None:
        if packet.step or packet.samples == 1:
            assert payload.parse(payload.build(packet)) == packet
        values, quality = payload.measured(packet.raw, packet.phases)
        assert len(values) == len(quality) == packet.samples
        for other in get_args(wire.Mode):
            found = wire.decoder(other).feed(wire.wrap(body, other) * 2) if len(body) <= payload.LONGEST else [packet]
            assert packet in found


def _fed(mode: wire.Mode, data: bytes, step: int) -> list[payload.Packet]:
    decoder = wire.decoder(mode)
    found = []
    for start in range(0, len(data), step):
        found += decoder.feed(data[start : start + step])
    return found


def _board(whole: list[payload.Packet], in_pieces: list[payload.Packet]) -> None:
    """What comes must not depend on the pieces; then up to samples."""
    assert whole == in_pieces
    inlet = CheckingInlet()
    boards: dict[int, Board] = {}
    arrival = inlet.now()
    for packet in whole:
        board = boards.setdefault(
            packet.phases, Board("board", board_stream(packet.phases, 123.0), packet.phases, 50_000_000, inlet)
        )
        arrival += 8_130_000
        board.take(packet, arrival)
        board.release(arrival)
    for board in boards.values():
        board.release(arrival, everything=True)
    assert np.isfinite(arrival)


def seeds() -> Iterable[bytes]:
    """Packets of both versions in every mode, one of them damaged."""
    later = PACKET._replace(sequence=1, time=16_000)
    single = payload.Packet(2, 7, 1000, 0, 3, (23000, 1500, 34500) * 3)
    for number, mode in enumerate(wire.MODES):
        frames = [wire.wrap(payload.build(p), mode, sender=5, explicit=p is later) for p in (PACKET, later, single)]
        yield bytes([number]) + b"".join(frames)
        yield bytes([number + 3 * 5]) + frames[0][:-4] + frames[1] + b"\x7e\x00" + frames[2]
    yield b"\0" + payload.build(single)[:-2]
    yield b"\0" + payload.build(PACKET)[:-2]
    yield b"\0\x7e\x00\x05\x88\x01BD\x00\xf0\x7e\x00\x02\x8a\x06\x6f"


TARGET = Target(run, seeds, 1024)
