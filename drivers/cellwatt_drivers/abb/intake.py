"""From EGM packets to the daemon: losses, duplicates, new sessions, the controller's clock."""

from __future__ import annotations

import math
from collections.abc import Callable

from cellwatt.account import Losses
from cellwatt.channel import Quality, Stream
from cellwatt.clock import unwrapped
from cellwatt.driver import Inlet
from cellwatt.errors import ProtocolError
from cellwatt_drivers.abb.wire import CYCLE, Columns, Packet, decode
from cellwatt_drivers.shared.rows import Row, Rows

_RECENT = 1000
"""Largest distance of a late or repeated packet behind the newest; further behind, numbering has restarted."""
_LONGEST_GAP = 1_000_000
"""More missing numbers than this mean a new numbering, not a loss."""
_FASTEST = 4_000_000
"""Shortest time between two packets, ns: numbers that run ahead of the controller's time are no loss either."""
_STEP = 200_000_000
"""Deviation, ns, of the controller's time from both the numbering and this PC's time that means a new time base."""
_WRAP = 1 << 32
_CYCLE = round(CYCLE * 1e9)
_REGULAR = 50
"""Steps between neighbouring packets, all of one length, that show at which rate the controller sends."""


class Intake:
    """Takes the datagrams of one robot in order, over all its connections, and counts them in its account.

    ``expect`` follows the packets' own numbers. Times are the controller's clock (µs) or, if it sends none, the
    unwrapped milliseconds of the header. ``rates`` has the rate at which the controller sends, if not the stream's.
    """

    def __init__(self, inlet: Inlet, stream: Stream, columns: Columns, delivers: Callable[[], None]) -> None:
        """``delivers`` is called before each block is handed over."""
        self.refused = ""
        """Why the newest datagram was invalid; empty since a valid one."""
        self.stream = stream
        self.rates: dict[str, float] = {}
        self._delivers = delivers
        self._inlet = inlet
        self._columns = columns
        self._period = self._step = round(1e9 / stream.rate)
        self._steps = 0
        """Latest steps of ``_step`` ns each."""
        self._newest: Packet | None = None
        self._time = 0
        self._arrival = 0
        self._sent: int | None = None
        self._losses = Losses(inlet.account)
        self._rows = Rows()

    def opened(self) -> None:
        """Mark that losses before the next packet belong to an outage."""
        self._losses.resumed = True

    def take(self, datagrams: list[bytes], waited: int = 0) -> None:
        """Decode and hand over datagrams that arrived ``waited`` ns ago; invalid ones are counted as ``malformed``."""
        arrival = max(self._arrival, self._inlet.now() - waited)  # the last is late by a pause since it was read
        for datagram in datagrams:
            try:
                packet = decode(datagram)
            except ProtocolError as error:
                self._inlet.account.anomaly("malformed")
                self.refused = str(error)
                continue
            if self._newest is None:
                self._report_surplus(packet)
            self.refused = ""
            self._continue(packet, arrival)
        self._hand_over(arrival)

    def _hand_over(self, arrival: int) -> None:
        if self._rows:
            self._delivers()
        self._rows.hand_over(self._inlet, self.stream, arrival)

    def _continue(self, packet: Packet, arrival: int) -> None:
        """Take a packet unless it is a repeat; count the packets missing before it."""
        time = self._unwrapped(packet.sent) if packet.clock is None else packet.clock
        newest, missing = self._newest, 0
        fault: str | None = None
        if newest is not None:
            ahead = packet.sequence - newest.sequence
            if -_RECENT < ahead <= 0 and time <= self._time:
                self._repeated(packet, ahead)
                return
            if ahead <= 0 or ahead > _LONGEST_GAP or ahead * _FASTEST > time - self._time + _STEP:
                self._inlet.account.anomaly("sessions")
            else:
                missing = ahead - 1
            same_clock = (packet.clock is None) == (newest.clock is None)
            fault = self._broken(same_clock, time, 1 + missing, arrival)
            if fault is None and ahead == 1:
                self._follow(time - self._time)
        if fault is not None:
            self._hand_over(arrival)
            self._inlet.clock_reset(self.stream, fault)
        self._losses.before_next(missing)
        self._newest, self._time, self._arrival = packet, time, arrival
        row = self._columns.row(packet.message)
        self._rows.append(Row(time, row, Quality.MISSING if all(map(math.isnan, row)) else Quality.GOOD))

    def _report_surplus(self, packet: Packet) -> None:
        """Report axes that the controller sends and the settings leave out."""
        measured, taken = packet.message.feedBack, (len(self._columns.arm), len(self._columns.external))
        sent = len(measured.joints.joints), len(measured.externalJoints.joints)
        if any(n > known for n, known in zip(sent, taken, strict=True)):
            text = "the controller sends {} joints and {} external axes, 'axes' and 'external' name {} and {}"
            self._inlet.event("axes_left_out", f"{text.format(*sent, *taken)}: the others are left out")

    def _repeated(self, packet: Packet, ahead: int) -> None:
        """Count a packet whose number was already received or skipped."""
        if ahead == 0 and packet != self._newest:
            self._inlet.account.forgery("contradicting packets")
        else:
            self._inlet.account.anomaly("duplicates" if ahead == 0 else "late packets")

    def _broken(self, same_clock: bool, time: int, steps: int, arrival: int) -> str | None:
        """Return why the controller's time has a new base since the last packet, or ``None``."""
        if not same_clock:
            return "the controller's clock appeared or disappeared"
        passed = time - self._time
        if passed <= 0:
            return "the controller's time went back"
        strange = abs(passed - steps * self._period) > _STEP and abs(passed - (arrival - self._arrival)) > _STEP
        return "the controller's time jumped" if strange else None

    def _follow(self, step: int) -> None:
        """Follow a controller that sends every n-th cycle with another n than the settings say.

        ``step`` is the time, ns, between two packets with neighbouring numbers.
        """
        step = _CYCLE * max(1, round(step / _CYCLE))
        self._steps = self._steps + 1 if step == self._step else 1
        self._step = step
        if step != self._period and self._steps >= _REGULAR:
            self._period, rate = step, 1e9 / step
            self.rates[self.stream.name] = rate
            text = f"the controller sends {rate:g} packets a second, 'rate' says {self.stream.rate:g} Hz"
            self._inlet.event("rate", f"{text}: see \\SampleRate of EGMStreamStart", rate=rate)

    def _unwrapped(self, sent: int) -> int:
        """Return the header's time, ns, unwrapped at 2³² ms."""
        self._sent = sent if self._sent is None else unwrapped(sent, _WRAP, self._sent)
        return self._sent * 1_000_000
