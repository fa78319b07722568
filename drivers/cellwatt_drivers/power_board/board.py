"""From one board's packets to samples of one stream, with counts of received and lost samples."""

from __future__ import annotations

import numpy as np

from cellwatt import Channel, Inlet, Reading, Stream
from cellwatt_drivers.power_board.clock import BoardClock
from cellwatt_drivers.power_board.payload import Packet, measured
from cellwatt_drivers.power_board.resequencer import Placed, Resequencer

_QUANTITIES = (("voltage", "V"), ("current", "A"), ("power", "W"))


def board_stream(phases: int, rate: float, board: int | None = None) -> Stream:
    """Stream of a board: the supply as a whole, then each phase.

    ``supply.power`` is the sum over the phases, ``supply.voltage`` their mean, ``supply.current`` their sum.
    With ``board``, every name begins with that number, for ports that several boards share.
    """
    prefix, name = ("", "power") if board is None else (f"board_{board}.", f"power_{board}")
    points = ["supply", *(f"phase_{n}" for n in range(1, phases + 1))]
    channels = tuple(Channel(f"{prefix}{point}.{what}", unit) for point in points for what, unit in _QUANTITIES)
    return Stream(name, channels, rate, "device")


class Board:
    """Takes one board's packets and emits their samples in the board's order.

    ``label`` names the board in messages; ``window`` ns as in ``Resequencer``.
    """

    def __init__(self, label: str, stream: Stream, phases: int, window: int, inlet: Inlet) -> None:
        self.stream = stream
        self._label = label
        self._last_packet = 0
        self._silent = False
        self._phases = phases
        self._inlet = inlet
        self._clock = BoardClock(stream.rate)
        self.order = Resequencer(window)
        """Its ``deadline`` is the cell's time, ns, at which ``release`` must be called even if no packet arrives."""

    def take(self, packet: Packet, arrival: int) -> None:
        """Take a packet that arrived at the cell's time ``arrival``, ns; ``release`` then emits due samples."""
        self._last_packet = arrival
        position = self._clock.place(packet, arrival)
        if position.verdict == "restarted":
            self.release(arrival, everything=True)
            self.order.restart()
            self._inlet.clock_reset(self.stream, "it restarted")
            self._inlet.event("board restarted", f"{self._label}: it restarted")
        outcome = self.order.put(Placed(packet, position.sequence, position.time, arrival))
        if outcome == "reordered":
            self._inlet.account.count(outcome)
        elif outcome:
            self._inlet.account.anomaly(outcome)

    def watch(self, now: int, since: int, silence: int) -> None:
        """Report when no packet has come for ``silence`` ns, counted from ``since`` on, and when packets resume."""
        silent = now - max(self._last_packet, since) > silence
        if silent != self._silent:
            self._silent = silent
            what = "silent" if silent else "heard again"
            self._inlet.event(f"board {what}", f"{self._label}: {what}")

    def release(self, now: int, *, everything: bool = False) -> None:
        """Emit packets that are in order, and with ``everything`` also those waiting for overtaken packets.

        ``now`` is the cell's time, ns.
        """
        account = self._inlet.account
        released = self.order.release(now, everything=everything)
        if not released:
            return
        for gap, placed in released:
            account.lose(gap, "gap")
            account.expect(placed.packet.samples)
        values, quality = measured([x for _, p in released for x in p.packet.raw], self._phases)
        total = np.stack([values[..., 0].mean(axis=1), values[..., 1].sum(axis=1), values[..., 2].sum(axis=1)], axis=1)
        rows = np.concatenate([total, values.reshape(len(values), -1)], axis=1)
        times = [p.time + i * p.packet.step for _, p in released for i in range(p.packet.samples)]
        device_time = np.array(times, dtype=np.int64) * 1000
        self._inlet.emit(Reading(self.stream, rows, now, device_time, quality=quality))
