"""Our framing of the transparent mode, and what is said of bytes that are not it."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_drivers.power_board import transparent, wire
from tests.drivers.power_board.samples import EXAMPLE, EXAMPLE_BYTES, NETWORK, SENDER

FRAME = bytes.fromhex("a55a22dd") + EXAMPLE_BYTES


def test_frame_as_documented() -> None:
    assert transparent.frame(EXAMPLE_BYTES) == FRAME
    assert wire.decoder("transparent").feed(FRAME) == [EXAMPLE]


@settings(deadline=None)
@given(st.integers(0, 12), st.lists(st.integers(0, 500), max_size=12))
def test_pieces_of_any_size_give_the_same(n: int, cuts: list[int]) -> None:
    for places in (sorted(cuts), range(n * len(FRAME))):
        taking, found, last = wire.decoder("transparent"), [], 0
        for cut in (*places, n * len(FRAME)):
            found += taking.feed((FRAME * n)[last:cut])
            last = max(last, cut)
        assert found == [EXAMPLE] * n
        assert not taking.counts


@settings(deadline=None)
@given(st.binary(max_size=400))
def test_what_waits_is_bounded_whatever_comes(garbage: bytes) -> None:
    taking = transparent.TransparentDecoder(lambda data: data)
    for _ in range(20):
        taking.feed(garbage)
        assert len(taking.scan.__self__._rest) < 4 + 255


IO_SAMPLE = bytes.fromhex("7e0016920013a200404011221a2bc101001c82001402250b3edc")
HI = bytes.fromhex("7e0014910013a200404011221a2be8e80011c105c1686988")


@pytest.mark.parametrize(
    ("data", "mode", "words"),
    [
        (FRAME * 3, "api", "AP=0): set mode: transparent, or set the receiver to AP=1"),
        (wire.wrap(EXAMPLE_BYTES, "api", sender=SENDER, network=NETWORK) * 3, "transparent", "set mode: api,"),
        (wire.wrap(EXAMPLE_BYTES, "api", sender=SENDER, network=NETWORK) * 3, "api_escaped", "set mode: api,"),
        (wire.wrap(EXAMPLE_BYTES, "api_escaped", sender=SENDER, network=NETWORK) * 3, "api", "set mode: api_escaped,"),
        (HI * 3, "api", "not a power board's payload"),
        (HI * 3, "transparent", "not a power board's payload"),
        (IO_SAMPLE * 3, "api", "none carries data"),
        (bytes(range(256)) * 4, "api", "wrong baud rate or mode?"),
        (b"", "transparent", "wrong baud rate or mode?"),
    ],
)
def test_diagnosis_names_what_it_looks_like(data: bytes, mode: wire.Mode, words: str) -> None:
    assert words in wire.diagnose(data, mode)
