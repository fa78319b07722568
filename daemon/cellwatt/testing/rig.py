"""Description of a driver with which the suite runs it against its emulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Any, Literal

from cellwatt.driver import Driver, Inlet
from cellwatt.emulation import Emulator, Fault
from cellwatt.emulation.faults import FaultKind
from cellwatt.registry import available

Transport = Literal["tcp", "udp", "pty"]

USUAL_FAULTS: dict[FaultKind, Fault] = {
    "delay": Fault("delay", probability=0.3, seconds=0.3),
    "stall": Fault("stall", seconds=1.0),
    "disconnect": Fault("disconnect", seconds=0.3),
    "clock_jump": Fault("clock_jump", seconds=5.0),
}
"""Injection of faults that need more than a probability."""


class NotConformingError(AssertionError):
    """A driver violates the contract; the text names the rule, the observation and the expectation."""


def require(condition: object, message: str) -> None:
    """Raise ``NotConformingError`` unless the condition holds."""
    if not condition:
        raise NotConformingError(message)


@dataclass(frozen=True)
class Rig:
    """A driver with the settings to test it.

    ``settings`` as in a settings file (``{"rate": "20 Hz"}``), without the device's address. ``address`` and
    ``options`` are the emulator's; instead of ``pty`` it gets the path of a link. ``transport`` is the kind at which
    the emulator listens, so that the suite can capture it; ``None`` if it cannot (a CAN bus, several connections).
    ``may_send`` returns whether bytes sent by the driver are allowed: those of a whole TCP connection, of one UDP
    datagram, of a serial port while open; by default nothing may be sent. ``warm_up`` is the number of samples before
    faults begin; ``faults`` replace the usual ones of their kind; ``accuracy`` is the largest relative error of a
    value, ``patience`` the time limit in s for anything awaited.
    """

    driver: type[Driver[Any]]
    settings: Mapping[str, Any] = field(default_factory=dict)
    transport: Transport | None = "tcp"
    may_send: Callable[[bytes], object] | None = None
    address: str = "127.0.0.1:0"
    options: Mapping[str, str] = field(default_factory=dict)
    faults: Mapping[FaultKind, Fault] = field(default_factory=dict)
    warm_up: int = 10
    accuracy: float = 0.02
    patience: float = 20.0

    @property
    def name(self) -> str:
        """Name of the driver in settings files. Raises ``NotConformingError`` if it is not registered."""
        value = f"{self.driver.__module__}:{self.driver.__name__}"
        for name, point in available("cellwatt.drivers").items():
            if point.value.rpartition(":")[2] == self.driver.__name__ and point.load() is self.driver:
                return name
        raise NotConformingError(
            f"{self.driver.__name__} is not registered: write NAME = {value!r} under "
            '[project.entry-points."cellwatt.drivers"] in pyproject.toml and install the package (pip install -e .)'
        )

    @property
    def emulator(self) -> type[Emulator]:
        """The class of the driver's emulator."""
        found: type[Emulator] = resolve_name(self.driver.emulator)
        return found

    def fault(self, kind: FaultKind) -> Fault:
        """The fault of this kind to inject."""
        return self.faults.get(kind) or USUAL_FAULTS.get(kind) or Fault(kind, probability=0.3)

    def place(self, address: str) -> dict[str, Any]:
        """The settings that lead the driver to its emulator at ``address``."""
        return self.emulator.settings_at(address, self.driver.Settings.model_construct(**self.settings))

    def written(self, address: str) -> dict[str, Any]:
        """The settings for a device at ``address``, as in a settings file."""
        return {**self.settings, **self.place(address)}

    def make(self, address: str, inlet: Inlet) -> Driver[Any]:
        """Create a driver for the device at ``address``."""
        return self.driver("device", self.driver.Settings.model_validate(self.written(address)), inlet)
