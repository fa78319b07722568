"""The emulator in virtual time, and what it refuses."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from cellwatt_drivers.power_board import wire
from cellwatt_drivers.power_board.clock import BoardClock
from cellwatt_drivers.power_board.emulator import AHEAD, MOST_WAITING, PowerBoardEmulator
from tests.drivers.power_board.rig import emulated
from tests.drivers.power_board.samples import Slope


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "AP1"}, "mode is one of api, api_escaped, transparent, not 'AP1'"),
        ({"batch": "11"}, "do not fit 255 bytes"),
        ({"rate": "0"}, "rate 0 is not within"),
    ],
)
def test_options_mistakes_are_refused(options: dict[str, str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        PowerBoardEmulator(Slope(), "pty", options=options)


class _Line:
    """A port that takes everything, in virtual time."""

    def __init__(self) -> None:
        self.opened = self.flushed = self.plugged = True
        self.unread = 0
        self.written = bytearray()

    def read(self) -> bytes:
        return b""

    def write(self, data: bytes) -> int:
        self.written += data
        return len(data)


class _Counting(Slope):
    """Signals that count how often they are computed."""

    asked = 0

    def at(self, t):
        self.asked += 1
        return super().at(t)


@pytest.mark.parametrize("heard", [True, False])
def test_a_board_that_stood_still_for_an_hour_is_back_within_one_tick(heard: bool) -> None:
    """What is lost is counted, not made: made sample by sample it would hold the port up for minutes."""
    signals = _Counting()
    board, line = PowerBoardEmulator(signals, "pty", epoch=0.0, options={"rate": "100"}), _Line()
    board._tick(line, 0.0)
    line.opened = heard
    board._tick(line, 3600.0)
    assert board.tally["made"] == board.tally["packets"] == 360_001
    assert board.tally["sent"] == (MOST_WAITING + 1 if heard else 1)
    assert board.tally["made"] == board.tally["sent"] + board.tally["unheard"]
    assert signals.asked <= MOST_WAITING // AHEAD + 3
    line.opened = True
    line.written.clear()
    board._tick(line, 3600.0)
    board._tick(line, 3600.5)
    assert wire.decoder("api").feed(bytes(line.written))


@pytest.mark.parametrize("wrap", [2**31, 2**32], ids=["signed", "unsigned"])
def test_nothing_is_lost_where_the_boards_microseconds_wrap(wrap: int) -> None:
    """35.8 and 71.6 minutes after its start, and at many wraps of its numbers before."""
    board, line = PowerBoardEmulator(Slope(), "pty", epoch=0.0, options={"rate": "100"}), _Line()
    board._tick(line, 0.0)
    line.written.clear()
    near = round(wrap / 1e6) - 30
    board.tally.update(made=near * 100, packets=near * 100)
    clock, decoder, numbers, times = BoardClock(100.0), wire.decoder("api"), [], []
    for tick in range(60 * 50):
        now = near + tick / 50
        board._tick(line, now)
        for packet in decoder.feed(bytes(line.written)):
            place = clock.place(packet, round(now * 1e9))
            assert place.verdict == "follows"
            numbers.append(place.sequence)
            times.append(place.time)
        line.written.clear()
    assert times[0] < wrap < times[-1]
    assert {b - a for a, b in pairwise(numbers)} == {1}
    assert {b - a for a, b in pairwise(times)} == {10_000}


async def test_link_lives_as_long_as_the_emulator(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to("/dev/left-over-by-a-killed-emulator")
    async with emulated(link=str(link)) as (_, port):
        assert port == str(link)
        assert str(link.readlink()).startswith("/dev/")
        assert link.exists()
    assert not link.is_symlink()
