"""The contract between the daemon and a device family."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Generic, Protocol, TypeVar

from pydantic import BaseModel, ConfigDict

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream


class SourceSettings(BaseModel):
    """Settings of one source; every driver derives its own. Unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    device_parts: ClassVar[tuple[str, ...]] = ()
    """Settings, beside host and port, that tell two devices at one address apart."""
    reached_by: ClassVar[tuple[str, ...]] = ("host",)
    """Settings of which one says where the device is; all but ``host`` are paths of serial ports or buses."""


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
        """Report that the sample with ``device_time`` ns was made no earlier than the cell's time ``not_before`` ns.

        Lets the clock model state a two-sided bound. Call it only if the device cannot have made the sample before
        a question that left at ``not_before``. An answer that arrives before the sample proves nothing: devices may
        answer ahead of older samples.
        """
        ...

    def clock_reset(self, stream: Stream, reason: str) -> None:
        """Report a new time base of the device (reboot, wrap that cannot be unwrapped): the old map is forgotten."""
        ...

    def event(self, kind: str, text: str, **data: str | float) -> None:
        """Report something worth a line in the log and on the bus; counted by kind."""
        ...


S = TypeVar("S", bound=SourceSettings)


class Driver(ABC, Generic[S]):
    """Reads one device and never writes a setting that outlives the connection, nor moves a robot.

    The daemon calls ``run`` in a task of its own and again, after a pause with back-off, each time it
    raises a ``SourceError``. ``run`` must be cancellable at every await and must release the device then.
    """

    Settings: ClassVar[type[SourceSettings]]
    title: ClassVar[str]
    """One line for ``cellwatt drivers``."""
    emulator: ClassVar[str]
    """``module:Class`` of the device's emulator."""
    least_delay: ClassVar[tuple[float, float]] = (0.0, 0.001)
    """Between what bounds, s, the shortest way from the device to the daemon lies; widens the clock's bound."""
    libraries: ClassVar[tuple[str, ...]] = ()
    """Modules that this driver imports on first use: the daemon loads them before a device is read, as that holds
    up all others."""
    writes: ClassVar[tuple[str, ...]]
    """Every kind of byte sequence this driver may send to the device, in words."""

    left_out: frozenset[str] = frozenset()
    """Channels that this device does not have, which was told when it answered: they are NaN, and no trouble."""

    def __init__(self, name: str, settings: S, inlet: Inlet) -> None:
        self.name = name
        self.settings = settings
        self.inlet = inlet
        self.gather: Callable[[], float] = lambda: 0.0
        """s for which what the device sends may wait to be read or decoded together, now; 0: take it as it comes. The
        daemon sets it. No time of arrival may depend on it: the kernel stamps what waits there."""

    @property
    def outlet(self) -> Inlet:
        """What ``inlet`` was called before."""
        return self.inlet

    @property
    @abstractmethod
    def streams(self) -> tuple[Stream, ...]:
        """Streams that will be delivered, from the settings alone, without the device."""

    @abstractmethod
    async def run(self) -> None:
        """Connect, call ``inlet.connected``, then emit until cancelled. Raises ``SourceError`` when it fails."""

    @abstractmethod
    async def identify(self) -> Identity:
        """Open the device read-only, ask who it is, close. Raises ``SourceError``."""
