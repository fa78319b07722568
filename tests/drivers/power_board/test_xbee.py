"""XBee API frames against the fact sheet's worked frames and Digi's own packet classes."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_drivers.power_board import wire, xbee
from tests.drivers.power_board.samples import EXAMPLE, EXAMPLE_BYTES, EXAMPLE_FRAME, NETWORK, SENDER

pytest.importorskip("digi.xbee", reason="digi-xbee is not installed")
from digi.xbee.models.address import XBee16BitAddress, XBee64BitAddress
from digi.xbee.models.mode import OperatingMode
from digi.xbee.packets.base import XBeePacket
from digi.xbee.packets.common import ExplicitRXIndicatorPacket, ReceivePacket
from digi.xbee.packets.factory import build_frame

DATA = bytes.fromhex("7e7d11136869")
PLAIN_90 = bytes.fromhex("7e0012900013a200404011221a2bc17e7d1113686911")
ESCAPED_90 = bytes.fromhex("7e001290007d33a20040407d31221a2bc17d5e7d5d7d317d3368697d31")
PLAIN_91 = bytes.fromhex("7e0014910013a200404011221a2be8e80011c105c1686988")
OTHERS = {
    "frames: IO sample": bytes.fromhex("7e0016920013a200404011221a2bc101001c82001402250b3edc"),
    "frames: transmit status": bytes.fromhex("7e00078b011a2b0000002e"),
    "frames: modem status": bytes.fromhex("7e00028a0273"),
    "frames: unknown type": bytes.fromhex("7e00040801415065"),
}


def decoder(*, escaped: bool = False) -> xbee.ApiDecoder[bytes]:
    """Takes any payload for good, so that framing is tested alone."""
    return xbee.ApiDecoder(lambda data: data, escaped=escaped)


def fed(stream: bytes, *, escaped: bool = False, cuts: tuple[int, ...] = ()) -> list[bytes]:
    taking, found, last = decoder(escaped=escaped), [], 0
    for cut in (*sorted(cuts), len(stream)):
        found += taking.feed(stream[last:cut])
        last = max(last, cut)
    return found


def test_worked_frames_are_built() -> None:
    data = xbee.receive_data(DATA, SENDER, NETWORK)
    assert xbee.frame(data) == PLAIN_90
    assert xbee.frame(data, escaped=True) == ESCAPED_90
    assert xbee.frame(xbee.receive_explicit_data(b"hi", SENDER, NETWORK)) == PLAIN_91
    assert wire.wrap(EXAMPLE_BYTES, "api", sender=SENDER, network=NETWORK) == EXAMPLE_FRAME
    assert xbee.frame(b"\x08\x01AP") == OTHERS["frames: unknown type"]


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("escaped", [False, True])
def test_other_frames_are_recognised_and_counted(name: str, escaped: bool) -> None:
    plain = OTHERS[name]
    stream = xbee.frame(plain[3:-1], escaped=escaped)
    assert escaped or stream == plain
    taking = decoder(escaped=escaped)
    good = xbee.frame(xbee.receive_data(b"ours", SENDER, NETWORK), escaped=escaped)
    assert taking.feed(stream + good) == [b"ours"]
    assert taking.counts[name] == 1


@settings(deadline=None)
@given(st.binary(max_size=255), st.integers(0, 2**64 - 1), st.integers(0, 2**16 - 1), st.booleans(), st.booleans())
def test_digi_builds_and_reads_the_same(data: bytes, sender: int, network: int, escaped: bool, explicit: bool) -> None:
    long, short = XBee64BitAddress(sender.to_bytes(8, "big")), XBee16BitAddress(network.to_bytes(2, "big"))
    if explicit:
        theirs = ExplicitRXIndicatorPacket(long, short, 0xE8, 0xE8, 0x0011, 0xC105, 0xC1, rf_data=data)
        ours = xbee.receive_explicit_data(data, sender, network)
    else:
        theirs = ReceivePacket(long, short, 0xC1, rf_data=data)
        ours = xbee.receive_data(data, sender, network)
    frame = xbee.frame(ours, escaped=escaped)
    assert frame == bytes(theirs.output(escaped=escaped))
    plain = XBeePacket.unescape_data(bytearray(frame)) if escaped else bytearray(frame)
    read = build_frame(plain, OperatingMode.API_MODE)
    assert bytes(read.rf_data or b"") == data
    assert fed(frame, escaped=escaped) == [data]


@settings(deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=8), st.booleans(), st.lists(st.integers(0, 900), max_size=12))
def test_pieces_of_any_size_give_the_same(payloads: list[bytes], escaped: bool, cuts: list[int]) -> None:
    stream = b"".join(xbee.frame(xbee.receive_data(p, SENDER, NETWORK), escaped=escaped) for p in payloads)
    assert fed(stream, escaped=escaped, cuts=tuple(cuts)) == payloads
    assert fed(stream, escaped=escaped, cuts=tuple(range(len(stream)))) == payloads


@settings(deadline=None)
@given(st.binary(max_size=400), st.booleans())
def test_what_waits_is_bounded_whatever_comes(garbage: bytes, escaped: bool) -> None:
    taking = decoder(escaped=escaped)
    for _ in range(20):
        taking.feed(garbage)
        assert len(taking.scan.__self__._rest) <= 2 * (xbee.LONGEST + 3) + 1


class TestResynchronisation:
    """AP=1: after a false start the scan goes on one byte later, in the same bytes."""

    def stream(self, *parts: bytes) -> list[bytes]:
        padding = bytes(xbee.LONGEST + 4)  # so that nothing still waits for its end
        taking = wire.decoder("api")
        return [p.sequence for p in taking.feed(b"".join(parts) + padding)]

    def test_false_start_that_claims_a_frame_behind_it(self) -> None:
        assert self.stream(b"\x7e\x00\x20", EXAMPLE_FRAME, EXAMPLE_FRAME) == [0x1234] * 2

    def test_chance_checksum_swallows_nothing(self) -> None:
        """A false start whose checksum is right by chance must not take the frame inside it."""
        inside = b"\x90" + EXAMPLE_FRAME
        false = b"\x7e" + len(inside).to_bytes(2, "big") + inside + bytes([0xFF - (sum(inside) & 0xFF)])
        assert self.stream(false) == [0x1234]

    def test_frames_of_another_device_are_counted_and_passed(self) -> None:
        taking = wire.decoder("api")
        assert taking.feed(PLAIN_90 + EXAMPLE_FRAME) == [EXAMPLE]
        assert taking.counts["foreign payloads"] == 1


def test_frame_without_its_escapes_is_refused() -> None:
    """Its sender's address, 00 13 A2 00 …, must travel escaped where AP=2 is set."""
    taking = wire.decoder("api_escaped")
    assert taking.feed(EXAMPLE_FRAME * 2) == []
    assert taking.counts["checksum"] == 2
