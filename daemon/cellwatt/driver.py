"""The contract between the daemon and a device family."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Generic, Protocol, TypeVar

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.section import Section


class SourceSettings(Section):
    """Settings of one source; every driver derives its own. Unknown keys are refused."""

    device_parts: ClassVar[tuple[str, ...]] = ()
    """Settings, beside host and port, that distinguish two devices at one address."""
    reached_by: ClassVar[tuple[str, ...]] = ("host",)
    """Settings that give the device's address, any one of them; all but ``host`` are paths of serial ports or buses."""
    line_parts: ClassVar[tuple[str, ...]] = ()
    """Settings of a serial line that several sources may share, in which all of them must agree."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of the device that answered: shown by ``doctor``, written into recordings."""

    maker: str
    model: str
    serial: str = ""
    firmware: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)


class Inlet(Protocol):
    """Receives what a driver reads. All methods return at once and are called on the event loop."""

    account: Account

    def now(self) -> int:
        """The cell's time, UTC ns; never steps back."""
        ...

    def connected(self, identity: Identity) -> None:
        """Report that the device answered and will deliver; resets the back-off."""
        ...

    def emit(self, reading: Reading) -> None:
        """Hand over a block, in order. The daemon counts it as received, then stamps, records and publishes it."""
        ...

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        """Report that the device made the sample with ``device_time`` ns no earlier than ``not_before``, cell's ns.

        Lets the clock model state a two-sided bound. Call it only if the device cannot have made the sample before it
        received a request that the driver sent at ``not_before``. A response that arrives before the sample proves
        nothing: devices may respond before they send older samples.
        """
        ...

    def clock_reset(self, stream: Stream, reason: str) -> None:
        """Report a new time base of the device (reboot, wrap that cannot be unwrapped): the clock map is discarded."""
        ...

    def event(self, kind: str, text: str, **data: str | float) -> None:
        """Report an event for the log and the bus; events are counted by kind."""
        ...


S = TypeVar("S", bound=SourceSettings)


class Driver(ABC, Generic[S]):
    """Reads one device and never writes a setting that outlives the connection, nor moves a robot.

    The daemon calls ``run`` in its own task, and again after a back-off pause each time it raises a ``SourceError``.
    ``run`` must be cancellable at every await and must then release the device.
    """

    Settings: ClassVar[type[SourceSettings]]
    title: ClassVar[str]
    """One line for ``cellwatt drivers``."""
    emulator: ClassVar[str]
    """``module:Class`` of the device's emulator."""
    least_delay: ClassVar[tuple[float, float]] = (0.0, 0.001)
    """Limits, s, of the shortest delay from the device to the daemon; their difference widens the clock's bound."""
    libraries: ClassVar[tuple[str, ...]] = ()
    """Modules that this driver imports on first use: the daemon imports them before it reads any device, because an
    import blocks all sources."""
    writes: ClassVar[tuple[str, ...]]
    """Every kind of byte sequence that this driver may send to the device, in words."""

    left_out: frozenset[str] = frozenset()
    """Channels that the device reported as missing when it responded: their values are NaN, which is no fault."""
    rates: Mapping[str, float] = {}
    """Rates, Hz, by stream, at which the device announced to send or regularly sends, if not the declared ones."""

    def __init__(self, name: str, settings: S, inlet: Inlet) -> None:
        self.name = name
        self.settings = settings
        self.inlet = inlet
        self.gather: Callable[[], float] = lambda: 0.0
        """Longest time, s, that data of the device may wait so that it is read or decoded in one block; 0: read it at
        once. The daemon sets it. Arrival times must not depend on it: the kernel stamps waiting data."""

    @property
    @abstractmethod
    def streams(self) -> tuple[Stream, ...]:
        """Streams that the driver will deliver, from the settings alone, without the device."""

    @abstractmethod
    async def run(self) -> None:
        """Connect, call ``inlet.connected``, then emit until cancelled. Raises ``SourceError`` when it fails."""

    @abstractmethod
    async def identify(self) -> Identity:
        """Open the device read-only, read its identity, close it. Raises ``SourceError``."""
