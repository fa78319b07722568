"""Mutated frames: no crash, no wrong value, no intact frame lost.

How it is judged. A payload that the decoder gives and nobody sent is right only as a true collision: an
independent bitwise CRC must hold over it, and there may be no more of those than chance explains (one in
65,536 for the CRC alone, 256 times fewer with the API checksum before it). A frame that was not mutated
must be found, whatever stands around it. The one exception is a frame cut off right before its last byte
where that byte was a start byte: it then borrows the start of the frame behind it, rightly, for nobody can
tell; mutations that do this, one in some 200, find such a byte once in 256.
"""

from __future__ import annotations

import random
from collections import Counter

import pytest

from cellwatt_drivers.power_board import payload, transparent, wire, xbee
from tests.drivers.power_board.samples import NETWORK, SENDER, bitwise_crc

BLOCK = 500
PADDING = bytes(600)


def mutate(rng: random.Random, frame: bytes) -> bytes:
    """The frame with one of the things done to it that happen to bytes on their way."""
    kind = rng.randrange(8)
    at = rng.randrange(len(frame))
    end = min(len(frame), at + rng.randrange(1, 20))
    if kind == 0:  # a flipped bit
        return frame[:at] + bytes([frame[at] ^ 1 << rng.randrange(8)]) + frame[at + 1 :]
    if kind == 1:  # a run of other bytes
        return frame[:at] + rng.randbytes(end - at) + frame[end:]
    if kind == 2:  # bytes lost
        return frame[:at] + frame[end:]
    if kind == 3:  # bytes put in
        return frame[:at] + rng.randbytes(rng.randrange(1, 20)) + frame[at:]
    if kind == 4:  # cut off
        return frame[:at]
    if kind == 5:  # a part twice
        return frame[:end] + frame[at:]
    if kind == 6:  # special bytes where they hurt
        return (
            frame[:at] + rng.choice([b"\x7e", b"\x7d", b"\x7e\x00", b"\xa5\x5a", b"\x7d\x7e", b"\x7d\x7d"]) + frame[at:]
        )
    swapped = bytearray(frame)  # two bytes change places
    other = rng.randrange(len(frame))
    swapped[at], swapped[other] = swapped[other], swapped[at]
    return bytes(swapped)


def any_payload(rng: random.Random) -> bytes:
    phases, samples = rng.randrange(1, 4), rng.choice([1, 1, 2])
    raw = any_values(rng, phases * samples)
    step = 8130 if samples > 1 else 0
    return payload.build(
        payload.Packet(rng.randrange(256), rng.randrange(2**16), rng.randrange(2**32), step, phases, raw)
    )


def any_values(rng: random.Random, n: int) -> tuple[int, ...]:
    return tuple(
        x for _ in range(n) for x in (rng.randrange(2**16), rng.randrange(2**16), rng.randrange(-(2**31), 2**31))
    )


def decoder(mode: wire.Mode):
    """Gives the payloads themselves, so that they can be compared byte by byte."""

    def parse(data: bytes) -> bytes | None:
        return None if payload.parse(data) is None else data

    if mode == "transparent":
        return transparent.TransparentDecoder(parse)
    return xbee.ApiDecoder(parse, escaped=mode == "api_escaped")


def fuzz(mode: wire.Mode, frames: int, seed: int) -> tuple[int, int]:
    """Collisions taken and intact frames lost among so many mutated ones; fails on a wrong value."""
    rng = random.Random(seed)
    collisions = lost = 0
    for _ in range(frames // BLOCK):
        taking, sent, intact, stream = decoder(mode), set(), Counter(), []
        for _ in range(BLOCK):
            data = any_payload(rng)
            sent.add(data)
            frame = wire.wrap(data, mode, sender=SENDER, network=NETWORK, explicit=rng.random() < 0.3)
            stream.append(mutate(rng, frame))
            if rng.random() < 0.5:
                good = any_payload(rng)
                sent.add(good)
                intact[good] += 1
                stream.append(wire.wrap(good, mode, sender=SENDER, network=NETWORK))
        whole = b"".join(stream) + PADDING
        found, at = Counter(), 0
        while at < len(whole):
            piece = whole[at : at + rng.randrange(1, 4000)]
            at += len(piece)
            found.update(taking.feed(piece))
        lost += (intact - found).total()
        for data in found:
            if data not in sent:
                assert bitwise_crc(data[:-2]) == data[-2] | data[-1] << 8, (mode, data.hex())
                collisions += 1
    return collisions, lost


def judge(mode: wire.Mode, frames: int, seed: int) -> None:
    collisions, lost = fuzz(mode, frames, seed)
    chance = frames / 65536
    api = mode != "transparent"
    assert collisions <= 3 + 2 * chance / (256 if api else 1), f"{collisions} collisions in {frames} frames"
    assert lost <= 3 + 2 * chance, f"{lost} intact frames lost among {frames} mutated ones"


@pytest.mark.parametrize("mode", wire.MODES)
def test_mutated_frames(mode: wire.Mode) -> None:
    judge(mode, 8_000, seed=1)
