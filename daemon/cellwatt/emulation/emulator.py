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
    """The device's side of the wire, good enough for other people's clients.

    ``address`` is where to listen: ``127.0.0.1:30004`` (port 0 for any free one), ``pty`` for a pseudo-terminal, or the
    path of a symbolic link to one; empty: ``usual_address``.
    ``epoch`` is the UTC time in s at which the signals' t is 0, so that emulators in several processes
    serve one world. ``options`` are the emulator's own (its docstring lists them); unknown ones raise
    ``ValueError``. ``counts`` tells what was truly sent and injected, ``tally`` is where it counts the former.
    """

    title: ClassVar[str]
    faults: ClassVar[tuple[FaultKind, ...]]
    """Fault kinds it can inject."""
    usual_address: ClassVar[str]
    """Address at which it listens by default."""
    usual_port: ClassVar[int] = 0
    """Port of a real device of its kind, for settings that name none."""
    changes: ClassVar[Mapping[str, str]] = {}
    """Changes that it knows beside those of the world, each with the key of its value in a fault's words."""
    line: ClassVar[str] = ""
    """Setting of the driver that holds the path of a serial port; empty where it is never behind one."""

    # the device of a source -----------------------------------------------------------------------

    @classmethod
    def address_in(cls, settings: SourceSettings) -> str:
        """Address at which a source looks for the device: HOST:PORT, or the path of a serial port.

        Raises ``ValueError`` where there can be no emulator for such settings.
        """
        if host := getattr(settings, "host", None):
            return f"{host}:{getattr(settings, 'port', None) or cls.usual_port}"
        if cls.line:
            return str(getattr(settings, cls.line))
        raise ValueError("its settings name neither a host nor a serial port")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """Options that make it the device which sources with these settings read, all at one address.

        Raises ``ValueError`` where it cannot be that device.
        """
        return {}

    @classmethod
    def free_address(cls, settings: SourceSettings) -> str:
        """An address for such a source at which nothing else listens."""
        return "127.0.0.1:0" if getattr(settings, "host", None) else "pty"

    @classmethod
    def settings_at(cls, address: str, settings: SourceSettings) -> dict[str, Any]:
        """Changed settings of a source, so that it reads the emulator at ``address``."""
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
        """True where it listens at a pseudo-terminal."""
        return self.address == "pty" or self.link is not None

    @property
    def link(self) -> Path | None:
        """Symbolic link to its pseudo-terminal."""
        return Path(self.address) if self.address.startswith("/") else None

    @abstractmethod
    def set_up(self, options: Options) -> None:
        """Take the emulator's own options and make what it needs. Raises ``ValueError`` for a wrong one."""

    def inject(self, fault: Fault) -> None:
        """Begin a fault; raises ``ValueError`` for a kind this device cannot have."""
        if fault.kind not in self.faults:
            raise ValueError(f"{self.title} cannot inject {fault.kind}; it can: {', '.join(self.faults)}")
        self.injector.inject(fault, time.monotonic())

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Make changes of the device itself, or of the emulated world. Raises ``ValueError`` for an unknown one."""
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
        """Time of the signals' world, s."""
        return time.time() - self.epoch

    def world(self) -> dict[str, float]:
        """The signals as they are now."""
        return {name: float(values[0]) for name, values in self.signals.at(np.array([self.elapsed])).items()}

    async def cycles(self, rate: float) -> AsyncIterator[tuple[int, int]]:
        """Cycles of a device at ``rate`` Hz: the number of each since the epoch, and how many more are due with it."""
        number = round(self.elapsed * rate)
        async with Ticker(rate) as ticker:
            async for beat in ticker:
                for behind in range(beat.merged, -1, -1):
                    yield number, behind
                    number += 1

    @property
    def counts(self) -> Mapping[str, int]:
        """Frames truly made (``made``), put on the wire (``sent``), and each fault injected, by kind."""
        return {**self.tally, **self.injector.counts}

    @abstractmethod
    async def serve(self, ready: Callable[[str], None]) -> None:
        """Serve until cancelled; calls ``ready`` with the real address (host:port or device path) once open."""
