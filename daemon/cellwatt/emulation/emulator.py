"""The contract of a device emulator."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping
from typing import ClassVar

from cellwatt.emulation.faults import Fault, FaultKind, Injector
from cellwatt.emulation.options import Options
from cellwatt.emulation.signals import Signals


class Emulator(ABC):
    """The device's side of the wire, good enough for other people's clients.

    ``address`` is where to listen (``127.0.0.1:30004``, port 0 for any free one, or ``pty``); empty: ``usual_address``.
    ``epoch`` is the UTC time in s at which the signals' t is 0, so that emulators in several processes
    serve one world. ``options`` are the emulator's own (its docstring lists them); unknown ones raise
    ``ValueError``. ``counts`` tells what was truly sent and injected, ``tally`` is where it counts the former.
    """

    title: ClassVar[str]
    faults: ClassVar[tuple[FaultKind, ...]]
    """Fault kinds it can inject."""
    usual_address: ClassVar[str]
    """Address at which it listens by default."""

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

    @abstractmethod
    def set_up(self, options: Options) -> None:
        """Take the emulator's own options and make what it needs. Raises ``ValueError`` for a wrong one."""

    def inject(self, fault: Fault) -> None:
        """Begin a fault; raises ``ValueError`` for a kind this device cannot have."""
        if fault.kind not in self.faults:
            raise ValueError(f"{self.title} cannot inject {fault.kind}; it can: {', '.join(self.faults)}")
        self.injector.inject(fault, time.monotonic())

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Change the emulated world. Raises ``ValueError`` for a change that it does not know."""
        self.signals.disturb(change)

    @property
    def counts(self) -> Mapping[str, int]:
        """Frames truly made (``made``), put on the wire (``sent``), and each fault injected, by kind."""
        return {**self.tally, **self.injector.counts}

    @abstractmethod
    async def serve(self, ready: Callable[[str], None]) -> None:
        """Serve until cancelled; calls ``ready`` with the real address (host:port or device path) once open."""
