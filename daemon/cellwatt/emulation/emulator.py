"""The contract of a device emulator."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from cellwatt.driver import SourceSettings
from cellwatt.emulation.faults import Fault, FaultKind, Injector
from cellwatt.emulation.options import Options
from cellwatt.emulation.signals import Signals
from cellwatt.ticker import Ticker


class Emulator(ABC):
    """The device's side of the wire, complete enough for third-party clients.

    ``address`` is where to listen: ``127.0.0.1:30004`` (port 0 for any free one), ``pty`` for a pseudo-terminal, or the
    path of a symbolic link to one; empty: ``usual_address``.
    ``epoch`` is the UTC time in s at which the signals' t is 0, so that emulators in several processes serve one world.
    ``options`` are the emulator's own, listed in its docstring; unknown ones raise ``ValueError``. ``counts`` returns
    the numbers of frames sent and faults injected; the emulator counts its frames in ``tally``.
    """

    title: ClassVar[str]
    faults: ClassVar[tuple[FaultKind, ...]]
    """Fault kinds that it can inject."""
    usual_address: ClassVar[str]
    """Address at which it listens by default."""
    usual_port: ClassVar[int] = 0
    """Port of a real device of this kind, for settings that name none."""
    changes: ClassVar[Mapping[str, str]] = {}
    """Changes that it can make beside those of the world, each with the key of its value in a fault's words."""
    line: ClassVar[str] = ""
    """Setting of the driver that holds the path of a serial port; empty if the device has no serial port."""

    # the device of a source -----------------------------------------------------------------------

    @classmethod
    def address_in(cls, settings: SourceSettings) -> str:
        """Address at which a source looks for the device: HOST:PORT, or the path of a serial port.

        Raises ``ValueError`` if no emulator can stand in for a device with such settings.
        """
        if host := getattr(settings, "host", None):
            return f"{host}:{getattr(settings, 'port', None) or cls.usual_port}"
        if cls.line:
            return str(getattr(settings, cls.line))
        raise ValueError("its settings name neither a host nor a serial port")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """Options with which it emulates the device that sources with these settings read, all at one address.

        Raises ``ValueError`` if it cannot emulate that device.
        """
        return {}

    @classmethod
    def free_address(cls, settings: SourceSettings) -> str:
        """An unused address for the emulator of such a source."""
        return "127.0.0.1:0" if getattr(settings, "host", None) else "pty"

    @classmethod
    def settings_at(cls, address: str, settings: SourceSettings) -> dict[str, Any]:
        """Settings of a source that must change so that it reads the emulator at ``address``."""
        if address.startswith("/"):
            return {cls.line: address}
        host, _, port = address.rpartition(":")
        return {"host": host, "port": int(port)}

    # the emulator ---------------------------------------------------------------------------------

    def __init__(
        self,
        signals: Signals,
        address: str,
        *,
        epoch: float | None = None,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
    ) -> None:
        self.signals = signals
        self.address = address or self.usual_address
        self.epoch = time.time() if epoch is None else epoch
        self.injector = Injector(seed)
        self.tally: Counter[str] = Counter(made=0, sent=0)
        taken = Options(options or {})
        self.set_up(taken)
        taken.refuse_rest()

    @property
    def on_terminal(self) -> bool:
        """True if it listens at a pseudo-terminal."""
        return self.address == "pty" or self.link is not None

    @property
    def link(self) -> Path | None:
        """Symbolic link to its pseudo-terminal; None without one."""
        return Path(self.address) if self.address.startswith("/") else None

    @abstractmethod
    def set_up(self, options: Options) -> None:
        """Read the emulator's own options and create its state. Raises ``ValueError`` for a wrong option."""

    def inject(self, fault: Fault) -> None:
        """Begin a fault; raises ``ValueError`` for a kind that this device cannot have."""
        if fault.kind not in self.faults:
            raise ValueError(f"{self.title} cannot inject {fault.kind}; it can: {', '.join(self.faults)}")
        self.injector.inject(fault, time.monotonic())

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Change the device itself, or the emulated world. Raises ``ValueError`` for an unknown change."""
        own = [kind for kind in self.changes if kind in change]
        for kind in own:
            self.change(kind, change[kind])
        if not own:
            self.signals.disturb(change)

    def change(self, kind: str, value: float | str) -> None:
        """Make one of ``changes``."""
        raise NotImplementedError(kind)

    @property
    def elapsed(self) -> float:
        """Time since the epoch, s."""
        return time.time() - self.epoch

    def world(self) -> dict[str, float]:
        """Present values of the signals, by channel."""
        return {name: float(values[0]) for name, values in self.signals.at(np.array([self.elapsed])).items()}

    async def cycles(self, rate: float) -> AsyncIterator[tuple[int, int]]:
        """Cycles of a device at ``rate`` Hz: the number of each since the epoch, and how many more are due now."""
        number = round(self.elapsed * rate)
        async with Ticker(rate) as ticker:
            async for beat in ticker:
                for behind in range(beat.merged, -1, -1):
                    yield number, behind
                    number += 1

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of frames computed (``made``) and sent (``sent``), and of faults injected, by kind."""
        return {**self.tally, **self.injector.counts}

    @abstractmethod
    async def serve(self, ready: Callable[[str], None]) -> None:
        """Serve until cancelled; calls ``ready`` with the real address (host:port or device path) once open."""
